"""Verdicts on walls are scored against the changes that were made; a drive is scored."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from small_ifc import STOREY, write_small_ifc
from study_rows import rows_of

from data import SceneGraph, WallSurface
from evaluation.metrics.as_built_scores import deviation_scores
from evaluation.metrics.true_walls import TrueWall
from evaluation.studies.as_built import Choice, cases, claims, measure, tables

pytestmark = pytest.mark.slow


def wall(name: str, kind: str, y: float, views: int = 5, shift: float = 0.0) -> TrueWall:
    return TrueWall(name, kind, (0.0, shift), views, ((0.0, y), (4.0, y), (4.0, y + 0.1), (0.0, y + 0.1)))


def told(kind: str, source: str, **more: Any) -> dict[str, Any]:
    a_id = f"{source}/1" if source else None
    return {"s_id": None, "a_id": a_id, "source": source, "kind": kind, "offset_m": None, "significant": True} | more


def test_each_kind_is_scored_by_wall() -> None:
    walls = [
        wall("m1", "moved", 0, shift=0.2), wall("m2", "moved", 2, shift=-0.1), wall("m3", "moved", 4, views=2),
        wall("a1", "absent", 6), wall("p1", "as planned", 8), wall("u1", "unplanned", 10), wall("u2", "unplanned", 12),
    ]  # fmt: skip
    plan = SceneGraph("bim", (), tuple(
        WallSurface(f"{w.id}/1", None, (2.0, 0.0), (0.0, -1.0), 4.0, source=w.id) for w in walls
    ))  # fmt: skip
    seen = SceneGraph("map", (), (
        WallSurface("s1", None, (2.0, 10.0), (0.0, -1.0), 3.0), WallSurface("s2", None, (2.0, 11.0), (0.0, -1.0), 3.0),
        WallSurface("s3", None, (6.0, 12.0), (0.0, -1.0), 7.0),
    ))  # fmt: skip
    found = deviation_scores([
        told("moved", "m1", offset_m=-0.19), told("moved", "m1", offset_m=0.0, significant=False),
        told("moved", "m3", offset_m=0.0), told("moved", "p1", offset_m=0.1), told("moved", "a1", offset_m=0.1),
        told("extra", "", s_id="s1"), told("extra", "", s_id="s2"), told("extra", "", s_id="s3"),
    ], seen, plan, np.eye(4), walls)  # fmt: skip
    moved, absent, extra = found["moved"], found["absent"], found["extra"]
    assert (moved.score.found, moved.score.expected, moved.score.right, moved.score.answered) == (1, 2, 2, 4)
    assert moved.missed == ("m2",) and moved.false == ("a1", "p1")
    np.testing.assert_allclose(sorted(moved.offset_errors), [0.0, 0.01])
    assert (absent.score.found, absent.score.expected, absent.score.answered) == (0, 1, 0)
    assert (extra.score.found, extra.score.expected, extra.score.right, extra.score.answered) == (2, 2, 2, 3)
    assert extra.false == ("s2",)


@pytest.mark.long
def test_a_moved_wall_of_a_drive_is_counted(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc")
    spec = {"name": "small", "bim": str(building.path), "storey": STOREY, "min_rooms": 3, "min_length": 12.0}
    (tmp_path / "list.yaml").write_text(yaml.safe_dump([spec]))
    choice = Choice(
        listed=tmp_path / "list.yaml", sequences=("small",), seeds=(3,), moved=0.2, gone=0, method="voting"
    )  # fmt: skip
    (case,) = cases(choice)
    record = measure(case, tmp_path)
    assert record.moved.score.expected == 1 and record.absent.score.expected == record.extra.score.expected == 0
    rows = rows_of([(case, record)])
    lines = tables(rows)["deviations"].to_numpy().tolist()
    assert [line[:5] for line in lines] == [
        ["small", "20 % moved", kind, "1", expected]
        for kind, expected in (("moved", "1"), ("absent", "0"), ("extra", "0"))
    ]
    assert claims(rows)[0].cases == f"{record.moved.score.found}/1 walls, 1 drives"
