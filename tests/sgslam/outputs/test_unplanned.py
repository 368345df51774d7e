"""What stands and no plan shows: which of it is a wall, each once, with its place; in the tables and in the report."""

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import two_rooms_seen as rooms
from report_samples import Page, reported
from two_rooms_seen import NEAR_ROOM, NOTHING, Corner, Floats, Places, box

from data.scene_graph import Door, Floor, Room, SceneGraph, WallSurface
from sgslam.as_built.elements.files import write_elements
from sgslam.as_built.unplanned.entries import UnplannedEntry
from sgslam.as_built.unplanned.stretches import Stretch, one_wall_each
from sgslam.report.elements import shown_as_element
from sgslam.report.page import report_html

OFFICE = Room("r", (0.0, 0.0), "F", "Office", ((-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)))
NORTH = WallSurface("north", "r", (0.0, 3.0), (0.0, -1.0), 6.0, "F")
PLAN = SceneGraph("bim", (OFFICE,), (NORTH,), (Door("d", ("r",), (3.1, 0.0)),), floors=(Floor("F", "Ground", 0.0),))
SOUTHWEST: Places = ((-2.7, -2.7), (-2.6, -2.6), (-2.7, -2.5), (-2.5, -2.7), (-2.6, -2.4))
NORTHWEST, SOUTHEAST = (tuple((sx * x, sy * y) for x, y in SOUTHWEST) for sx, sy in ((1, -1), (-1, 1)))
WEST, SOUTH, EAST = SOUTHWEST + NORTHWEST, SOUTHWEST + SOUTHEAST, tuple((-x, y) for x, y in SOUTHWEST + NORTHWEST)
NORMALS = {"west": (-1.0, 0.0), "east": (1.0, 0.0), "north": (0.0, 1.0), "south": (0.0, -1.0)}


def mapped(side: str, low: Corner, high: Corner) -> WallSurface:
    """The surface on one side of a cuboid."""
    n, size = np.array(NORMALS[side]), np.subtract(high, low)[:2]
    x, y = (np.add(low, high)[:2] / 2 + n * size / 2).tolist()
    return WallSurface(side, None, (x, y), NORMALS[side], float(abs(n[::-1]) @ size), "m", height=(0.0, rooms.HEIGHT))


def unplanned(
    sides: str, low: Corner, high: Corner, places: Places, built: Sequence[Floats] = (), others: Floats = NOTHING
) -> tuple[UnplannedEntry, ...]:
    """Entries of the cuboid, or of what is `built` within it, of which the map has these `sides`."""
    s_graph = SceneGraph("map", (), tuple(mapped(s, low, high) for s in sides.split()), floors=(Floor("m", "", 0.0),))
    elements = [own for own in rooms.planned() if own.global_id in ("wall", "shell")]
    views = rooms.views_of(rooms.SHELL, rooms.WALL, *(built or [box(low, high)]), places=places)
    of = {"s_graph": s_graph, "plan": PLAN, "matches": {"floor": "F"}}
    return rooms.assessed(elements, views, others=others, **of).unplanned


@pytest.mark.parametrize(
    ("sides", "low", "high", "places", "is_wall"),
    [
        ("west", (0.0, -1.5, 0.0), (0.12, 1.5, 2.6), WEST, True),
        ("east", (0.0, -1.5, 0.0), (0.12, 1.5, 2.6), EAST, True),
        ("west east", (0.0, -0.6, 0.0), (0.12, 0.6, 2.6), WEST + EAST, True),
        ("west east", (0.0, -0.3, 0.0), (0.12, 0.3, 2.6), WEST + EAST, False),  # short
        ("west east", (0.0, -1.5, 0.0), (0.12, 1.5, 1.6), WEST + EAST, True),
        ("west east", (0.0, -1.5, 0.0), (0.12, 1.5, 1.1), WEST + EAST, False),  # low
        ("west", (0.0, -1.5, 0.0), (0.12, 1.5, 1.6), WEST, False),
        ("west east", (0.0, -1.5, 0.0), (0.4, 1.5, 1.7), WEST + EAST, False),  # as thick as a box
        ("south", (-1.0, 1.7, 0.0), (0.5, 2.3, 2.3), SOUTH, True),
        ("south", (-1.0, 2.4, 0.0), (0.5, 3.0, 2.3), SOUTH, False),  # at a planned wall: may be a cupboard
        ("north south", (2.0, -1.9, 0.0), (2.96, -1.85, 2.1), SOUTHWEST + NEAR_ROOM, True),
        ("north south", (2.0, -0.55, 0.0), (2.96, -0.5, 2.1), SOUTHWEST + NEAR_ROOM, False),  # may be the door's leaf
    ],
)
def test_thin_or_tall_upright_things_are_walls_unless_they_may_be_cupboards_or_leaves(
    sides: str, low: Corner, high: Corner, places: Places, is_wall: bool
) -> None:
    (found,) = unplanned(sides, low, high, places)
    assert (found.kind, found.surfaces) == (("wall-like", tuple(sides.split())) if is_wall else ("furniture-like", ()))


@pytest.mark.parametrize(("spacing", "walls"), [(0.1, 1), (0.3, 0)])
def test_posts_that_are_seen_through_are_no_wall(spacing: float, walls: int) -> None:
    posts = [box((0.0, y, 0.0), (0.06, y + 0.06, 2.6)) for y in np.arange(-1.5, 1.5, spacing)]
    found = unplanned("west east", (0.0, -1.5, 0.0), (0.06, 1.5, 2.6), WEST + EAST, posts)
    assert sum(own.kind == "wall-like" for own in found) == walls and found


def test_what_is_planned_besides_explains_what_stands_there() -> None:
    stairs: tuple[Corner, Corner] = (-2.0, -2.0, 0.0), (-1.0, -1.0, 1.0)
    (found,) = unplanned("", *stairs, EAST)
    assert found.kind == "furniture-like" and not unplanned("", *stairs, EAST, others=box(*stairs))
    assert len(unplanned("", *stairs, EAST, others=box((1.0, -2.0, 0.0), (2.0, -1.0, 1.0)))) == 1


PIECES = ((-0.12, -1.0, 0.5, 2.5), (0.02, 1.0, 3.0, 4.0))  # the back, and what goes on behind a door
OTHERS = ((0.02, 1.0, 3.3, 4.0), (0.12, -1.0, 0.5, 2.5), (-3.0, -1.0, 0.0, 2.0))  # beyond a passage, a slit, a room


def test_faces_and_pieces_of_one_wall_are_one() -> None:
    """Stretches across y, that face so, from an x to another."""
    face, *others = (
        Stretch("", "f", np.array([low, y]), np.array([high, y]), np.array([0.0, facing]), (0.0, 2.5))
        for y, facing, low, high in ((0.0, 1.0, 0.0, 2.0), *PIECES, *OTHERS)
    )
    for pair in ((face, other) for other in others):
        assert len(one_wall_each(pair)) == len(one_wall_each(pair[::-1])) == (1 if pair[1] in others[:2] else 2)


def test_tables_and_report_have_it_without_a_global_id_and_count_planned_ones_alone(
    tmp_path: Path, anchored_run: Path
) -> None:
    (wall,) = unplanned("west", (0.0, -1.5, 0.0), (0.12, 1.5, 2.6), WEST)
    assert (wall.id, wall.room, wall.storey, wall.facing) == ("west", "Office", "Ground", (-1.0, 0.0))
    np.testing.assert_allclose(sorted(wall.trace), [(0.0, -1.5), (0.0, 1.5)], atol=0.1)
    assert wall.length_m == pytest.approx(3.0, abs=0.15) and 0.0 < wall.height_m[0] < 0.4 < 2.0 < wall.height_m[1] < 2.7
    thing = replace(wall, id="thing", kind="furniture-like")
    write_elements(tmp_path, [], 0.01, [asdict(wall), asdict(thing)])
    (row,) = csv.DictReader((tmp_path / "elements.csv").open())
    assert (row["verdict"], row["GlobalId"], row["room"], row["storey"]) == ("unplanned", "", "Office", "Ground")
    assert float(row["length (m)"]) == wall.length_m
    content = json.loads((tmp_path / "elements.json").read_text())
    assert [own["id"] for own in content["unplanned"]] == ["west", "thing"]
    assert content["elements"] == [] and content["counts"] == {}
    data = reported(anchored_run)
    page = Page(report_html(replace(data, elements=[*data.elements, shown_as_element(asdict(wall))]))).text
    assert f"of {len(data.elements)} planned elements seen" in page and "3.0 m, not planned" in page
