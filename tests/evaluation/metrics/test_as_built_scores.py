"""Verdicts on walls are scored against the changes that were made."""

from typing import Any

import numpy as np

from data import SceneGraph, WallSurface
from evaluation.metrics.as_built_scores import deviation_scores
from evaluation.metrics.true_walls import TrueWall


def wall(name: str, kind: str, y: float, views: int = 5, shift: float = 0.0) -> TrueWall:
    return TrueWall(name, kind, (0.0, shift), views, ((0.0, y), (4.0, y), (4.0, y + 0.1), (0.0, y + 0.1)))


def reported(kind: str, source: str, **more: Any) -> dict[str, Any]:
    a_id = f"{source}/1" if source else None
    return {"s_id": None, "a_id": a_id, "source": source, "kind": kind, "offset_m": None, "significant": True} | more


def surface(name: str, x: float, y: float, length: float, source: str = "") -> WallSurface:
    return WallSurface(name, None, (x, y), (0.0, -1.0), length, source=source)


def test_each_kind_is_scored_by_wall() -> None:
    walls = [
        wall("m1", "moved", 0, shift=0.2), wall("m2", "moved", 2, shift=-0.1), wall("m3", "moved", 4, views=2),
        wall("a1", "absent", 6), wall("p1", "as planned", 8), wall("u1", "unplanned", 10), wall("u2", "unplanned", 12),
    ]  # fmt: skip
    plan = SceneGraph("bim", (), tuple(surface(f"{w.id}/1", 2.0, 0.0, 4.0, w.id) for w in walls))
    at = {"s1": (2.0, 10.0, 3.0), "s2": (2.0, 11.0, 3.0), "s3": (6.0, 12.0, 7.0)}
    seen = SceneGraph("map", (), tuple(surface(name, *place) for name, place in at.items()))
    moved = {"m3": 0.0, "p1": 0.1, "a1": 0.1, "m1": -0.19}
    found = deviation_scores(
        [
            *(reported("moved", name, offset_m=offset) for name, offset in moved.items()),
            reported("moved", "m1", offset_m=0.0, significant=False), *(reported("extra", "", s_id=s) for s in at),
        ],
        seen, plan, np.eye(4), walls,
    )  # fmt: skip
    counts = {k: (v.score.found, v.score.expected, v.score.right, v.score.answered) for k, v in found.items()}
    assert counts == {"moved": (1, 2, 2, 4), "absent": (0, 1, 0, 0), "extra": (2, 2, 2, 3)}
    assert found["moved"].missed == ("m2",) and found["moved"].false == ("a1", "p1") and found["extra"].false == ("s2",)
    np.testing.assert_allclose(sorted(found["moved"].offset_errors), [0.0, 0.01])
