"""Walls that no plan shows: each once, with its place; in the tables and in the report."""

import csv
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import triangles_of
from report_samples import Page, reported
from sgslam.as_built.elements.wall_faces import Face, one_wall_each
from sgslam.as_built.planned_things import without_planned_things

from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from sgslam.as_built.elements import UnplannedEntry, unplanned_walls
from sgslam.as_built.elements.files import write_elements
from sgslam.report.elements import shown_as_element
from sgslam.report.page import report_html

OFFICE = Room("r", (2.0, 2.0), "F", "Office", ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
PLAN = SceneGraph("bim", (OFFICE,), floors=(Floor("F", "Ground", 10.0),))


def _face(name: str, y: float, facing: float, low: float, high: float) -> Face:
    """A face across y, from x = `low` to `high`."""
    return Face(name, "f", ((low, y), (high, y)), (0.0, facing), (0.0, 2.5), "long")


@pytest.mark.parametrize(
    ("other", "walls"),
    [
        (_face("back", -0.12, -1.0, 0.5, 2.5), 1),
        (_face("piece", 0.02, 1.0, 3.0, 4.0), 1),
        (_face("across a slit", 0.12, -1.0, 0.5, 2.5), 2),
        (_face("other side of a room", -3.0, -1.0, 0.0, 2.0), 2),
        (Face("across", "f", ((2.0, 0.0), (2.0, 2.0)), (1.0, 0.0), (0.0, 2.5), "long"), 2),
    ],
)
def test_faces_and_pieces_of_one_wall_are_one(other: Face, walls: int) -> None:
    face = _face("face", 0.0, 1.0, 0.0, 2.0)
    assert len(one_wall_each([face, other])) == len(one_wall_each([other, face])) == walls


def _found(trace: tuple[float, float] | None = None) -> UnplannedEntry:
    """Of a map whose frame lies at (1, 0, 10) in the BIM frame, with a wall of 2 m in it."""
    surface = WallSurface("w1", None, (1.0, 2.0), (0.0, 1.0), 2.0, "m", height=(0.1, 2.4))
    back = WallSurface("w2", None, (1.2, 1.9), (0.0, -1.0), 1.0, "m", height=(0.3, 2.5))
    s_graph = SceneGraph("map", (), (surface, back), floors=(Floor("m", "", 0.0),))
    told: list[dict[str, Any]] = [{"kind": "extra", "s_id": name, "reason": "long"} for name in ("w1", "w2")]
    if trace is not None:
        told[0]["trace"] = [[trace[1], 2.0], [trace[0], 2.0]]
    T = np.eye(4)
    T[:3, 3] = 1.0, 0.0, 10.0
    moved = {"kind": "moved", "s_id": "w1"}
    (wall,) = unplanned_walls([*told, moved], s_graph, T, {"floor": "F"}, PLAN)
    return wall


def test_an_entry_tells_place_size_and_room() -> None:
    """Of the surface that continues a planned wall, only the part that is not planned is listed."""
    wall = _found()
    assert (wall.id, wall.surfaces, wall.room, wall.storey) == ("w1", ("w1", "w2"), "Office", "Ground")
    np.testing.assert_allclose(sorted(wall.trace), [(1.0, 2.0), (3.0, 2.0)])
    assert wall.length_m == pytest.approx(2.0) and wall.height_m == pytest.approx((10.1, 12.5))
    assert wall.facing == pytest.approx((0.0, 1.0)) and wall.reason == "long"
    assert _found((1.5, 2.5)).length_m == pytest.approx(1.2)  # the back reaches 0.2 m further


def test_tables_and_report_have_it_without_a_global_id_and_count_planned_ones_alone(
    tmp_path: Path, anchored_run: Path
) -> None:
    wall = _found()
    write_elements(tmp_path, [], 0.01, [wall])
    (row,) = csv.DictReader((tmp_path / "elements.csv").open())
    assert (row["verdict"], row["GlobalId"], row["room"], row["storey"]) == ("unplanned", "", "Office", "Ground")
    assert float(row["length (m)"]) == pytest.approx(2.0) and row["z (m)"] == "10.10 to 12.50"
    told = json.loads((tmp_path / "elements.json").read_text())
    assert told["unplanned"][0]["id"] == "w1" and told["elements"] == [] and told["counts"] == {}
    data = reported(anchored_run)
    page = Page(report_html(replace(data, elements=[*data.elements, shown_as_element(asdict(wall))]))).text
    assert f"of {len(data.elements)} planned elements seen" in page and "2.0 m, not planned" in page


@pytest.mark.parametrize(("low", "spacing", "left"), [(10.0, 0.1, 0), (10.0, 0.5, 1), (13.0, 0.1, 1)])
def test_where_the_plan_has_a_railing_there_is_no_extra_wall(low: float, spacing: float, left: int) -> None:
    """Of bars, 1 m high, along y; four posts are no railing, nor is one of the storey above. The map's frame lies at
    (4, 0, 9.9) in the BIM frame, its floor 0.1 m above it."""
    bars = [(5.0, y, low, 5.01, y + 0.05, low + 1.0) for y in np.arange(0.0, 2.0, spacing)]
    surface = WallSurface("w1", None, (1.0, 1.0), (1.0, 0.0), 2.0, "m", height=(0.1, 1.1))
    s_graph = SceneGraph("map", (), (surface,), floors=(Floor("m", "", 0.1),))
    T_bim_map = np.eye(4)
    T_bim_map[:3, 3] = 4.0, 0.0, 9.9
    told: list[Any] = [{"kind": "extra", "s_id": "w1", "reason": "long"}]
    assert len(without_planned_things(told, s_graph, T_bim_map, triangles_of(bars))) == left
