"""Which anchors aligned walls become, and the rooms that follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import pose
from numpy.typing import NDArray

from data import Room, SceneGraph, WallSurface
from sgslam.anchoring.anchored_rooms import anchor_statuses, matched_rooms, planned_walls, room_anchors
from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment
from sgslam.mapping import PlannedWall, Scene
from sgslam.mapping.keyframes import RoomNode

SEEN = WallSurface("s", "r", (1.0, 0.0), (0.0, 1.0), 2.0, height=(0.0, 2.0))
PLANNED = WallSurface("a", "A", (1.0, 0.0), (0.0, 1.0), 2.0)
SCENE = Scene(SceneGraph("map", (Room("r", (1.0, 1.0)),), (SEEN,)), {"s": 7, "t": 8}, [], {})
Rooms = dict[tuple[str, str], dict[int, NDArray[np.float64]]]


def wall(
    room: str | None, planned: str | None, length: float | None = 2.0, off: float = 0.0, ids: str = "sa"
) -> AlignedWall:
    """A wall that agrees with the others unless it is off."""
    seen = replace(SEEN, id=ids[0], room=room, length=length)
    return AlignedWall(seen, replace(PLANNED, id=ids[1], room=planned), off, not off)


def of(*walls: AlignedWall) -> WallAlignment:
    return WallAlignment(list(walls), np.zeros(3), 0.03, 0.8)


@pytest.mark.parametrize(
    ("in_rooms", "match", "expected"),
    [
        # the match says A, where two metres stand: unless twice as much stands elsewhere
        ([("r", "A", 1.0), ("r", "A", 1.0), ("r", "B", 4.0)], (("r", "A", 0.9),), [["r", "A", 0.9]]),
        ([("r", "A", 1.0), ("r", "A", 1.0), ("r", "B", 4.1)], (("r", "A", 0.9),), [["r", "B", 0.4]]),
        # rooms follow from walls only where there is no match of rooms
        ([("r", "B", 1.0), ("r", "C", 3.0), (None, "B", 2.0), ("q", None, 2.0), ("p", "D", None)], (),
         [["p", "D", 0.4], ["r", "C", 0.4]]),
        ([("r", "B", 1.0), ("p", "D", None)], (("o", "O", 0.8),), [["o", "O", 0.8]]),
    ],
)  # fmt: skip
def test_a_room_is_that_of_the_match_unless_most_of_its_walls_stand_elsewhere(
    in_rooms: list[tuple[str | None, str | None, float | None]],
    match: tuple[tuple[str, str, float], ...],
    expected: list[list[str | float]],
) -> None:
    assert matched_rooms([wall(*own) for own in in_rooms], match, 0.4) == expected


@pytest.mark.parametrize(("matched", "by"), [({(7, "a")}, "match 3"), (set(), "position")])
def test_statuses_say_why_a_wall_anchors_the_map(matched: set[tuple[int, str]], by: str) -> None:
    tight, loose = wall("r", "A"), wall("r", "A", off=-0.1)
    for walls, state, why in (
        ((tight,), "tight", "as planned within 30 mm"),
        ((loose,), "loose", "-100 mm off the plan"),
        ((tight, loose), "tight", "as planned"),  # two pieces of one wall at one planned surface
        ((loose, tight), "tight", "as planned"),
    ):
        found = anchor_statuses(of(*walls), SCENE, matched, "match 3")[7, "a"]
        assert (found.state, found.by) == (state, by) and found.why.startswith(why)


def anchored(*walls: AlignedWall) -> tuple[dict[int, list[PlannedWall]], Rooms]:
    """In a local frame whose origin is at y = 3 m, in which the map lies 5 m high."""
    statuses = anchor_statuses(of(*walls), SCENE, set(), "match 1")
    return planned_walls(of(*walls), SCENE, statuses, pose(0.0, 0.0, 5.0), np.array([0.0, 3.0, 0.0]))


def test_all_walls_are_anchored_and_those_that_agree_anchor_their_rooms() -> None:
    other = wall("r", "A", ids="td")
    found, by_rooms = anchored(wall("r", "A", off=0.1), other)
    assert {w: [p.a_id for p in planned] for w, planned in found.items()} == {7: ["a"], 8: ["d"]}
    assert {rooms: list(walls) for rooms, walls in by_rooms.items()} == {("r", "A"): [8]}
    assert not anchored(wall(None, "A"))[1] and not anchored(wall("r", None))[1]
    assert found[7][0].plane == pytest.approx([0.0, 1.0, 0.0, 3.0])
    assert found[7][0].place == pytest.approx([1.0, 0.0, 6.0])


def test_a_room_is_anchored_by_walls_of_two_directions_in_one_planned_room() -> None:
    planes = {1: np.array([1.0, 0, 0, 0]), 2: np.array([0, 1.0, 0, 0]), 3: np.array([-1.0, 0, 0, 4.0])}
    in_room = {k: plane + np.array([0, 0, 0, 2.0 * plane[0] + plane[1]]) for k, plane in planes.items()}
    scene = Scene(SCENE.graph, {}, [RoomNode(5, np.eye(4), in_room)], {5: "r"})
    found = room_anchors(scene, {("r", "A"): planes, ("r", "B"): {1: planes[1]}, ("q", "C"): planes}, 1.5)
    assert found[5][:3, 3] == pytest.approx([2.0, 1.0, 1.5])
    assert room_anchors(scene, {("r", "A"): {k: planes[k] for k in (1, 3)}}, 1.5) == {}
    assert room_anchors(scene, {("q", "C"): planes}, 1.5) == {}
