"""Which anchors aligned walls become, and the rooms that follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from data import Room, SceneGraph, WallSurface
from sgslam.anchoring.anchored_rooms import anchor_statuses, matched_rooms, planned_walls, room_anchors
from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment
from sgslam.mapping import PlannedWall, Scene
from sgslam.mapping.graph_nodes import RoomNode

GATE = 0.03
SEEN = WallSurface("s", "r", (1.0, 0.0), (0.0, 1.0), 2.0, height=(0.0, 2.0))
PLANNED = WallSurface("a", "A", (1.0, 0.0), (0.0, 1.0), 2.0)
SCENE = Scene(SceneGraph("map", (Room("r", (1.0, 1.0)),), (SEEN,)), {"s": 7, "t": 8}, [], {})


def wall(
    room: str | None, planned: str | None, length: float | None = 2.0, offset: float = 0.0, agrees: bool = True,
    ids: tuple[str, str] = ("s", "a"),
) -> AlignedWall:  # fmt: skip
    seen = replace(SEEN, id=ids[0], room=room, length=length)
    return AlignedWall(seen, replace(PLANNED, id=ids[1], room=planned), offset, agrees)


def of(*walls: AlignedWall) -> WallAlignment:
    return WallAlignment(list(walls), np.zeros(3), GATE, 0.8)


@pytest.mark.parametrize(
    ("in_other", "room"), [(4.0, ["r", "A", 0.9]), (4.1, ["r", "B", 0.4])]
)  # the match says A, where two metres stand
def test_a_room_is_that_of_the_match_unless_twice_as_much_of_its_walls_stands_elsewhere(
    in_other: float, room: list[str | float]
) -> None:
    walls = [wall("r", "A", 1.0), wall("r", "A", 1.0), wall("r", "B", in_other)]
    assert matched_rooms(walls, (("r", "A", 0.9),), 0.4) == [room]


def test_rooms_without_a_match_follow_from_walls_only_where_there_is_no_match_of_rooms() -> None:
    walls = [wall("r", "B", 1.0), wall("r", "C", 3.0), wall(None, "B"), wall("q", None), wall("p", "D", None)]
    assert matched_rooms(walls, (), 0.4) == [["p", "D", 0.4], ["r", "C", 0.4]]
    assert matched_rooms(walls, (("o", "O", 0.8),), 0.4) == [["o", "O", 0.8]]


def test_statuses_tell_why_a_wall_anchors_the_map() -> None:
    pair = {(7, "a")}
    for aligned, status, why in (
        (wall("r", "A"), "tight", "as planned within 30 mm"),
        (wall("r", "A", agrees=False, offset=-0.1), "loose", "-100 mm off the plan"),
    ):
        for matched, by in ((pair, "match 3"), (set(), "position")):
            found = anchor_statuses(of(aligned), SCENE, matched, "match 3")[7, "a"]
            assert (found.state, found.by) == (status, by) and found.why.startswith(why)
    tight, loose = wall("r", "A"), wall("r", "A", agrees=False, offset=0.1)
    for walls in ((tight, loose), (loose, tight)):  # two pieces of one wall at one planned surface
        assert anchor_statuses(of(*walls), SCENE, pair, "match 3")[7, "a"].state == "tight"


Rooms = dict[tuple[str, str], dict[int, NDArray[np.float64]]]


def anchored(
    *walls: AlignedWall, T_local_level: NDArray[np.float64] | None = None, origin: float = 0.0
) -> tuple[dict[int, list[PlannedWall]], Rooms]:
    alignment, T_local_level = of(*walls), np.eye(4) if T_local_level is None else T_local_level
    statuses = anchor_statuses(alignment, SCENE, set(), "match 1")
    return planned_walls(alignment, SCENE, statuses, T_local_level, np.array([0.0, origin, 0.0]))


def test_all_walls_are_anchored_and_those_that_agree_anchor_their_rooms() -> None:
    off, other = wall("r", "A", offset=0.1, agrees=False), wall("r", "A", ids=("t", "d"))
    found, by_rooms = anchored(off, other)
    assert {w: [p.a_id for p in planned] for w, planned in found.items()} == {7: ["a"], 8: ["d"]}
    assert {rooms: list(walls) for rooms, walls in by_rooms.items()} == {("r", "A"): [8]}
    assert not anchored(replace(other, surface=replace(other.surface, room=None)))[1]
    assert not anchored(replace(other, planned=replace(other.planned, room=None)))[1]


def test_the_plane_of_a_planned_wall_is_in_the_local_frame() -> None:
    T_local_level = np.eye(4)
    T_local_level[2, 3] = 5.0
    (found,) = anchored(wall("r", "A"), T_local_level=T_local_level, origin=3.0)[0][7]
    assert found.plane == pytest.approx([0.0, 1.0, 0.0, 3.0])
    assert found.place == pytest.approx([1.0, 0.0, 6.0])


def test_a_room_is_anchored_by_walls_of_two_directions_in_one_planned_room() -> None:
    planes = {1: np.array([1.0, 0, 0, 0]), 2: np.array([0, 1.0, 0, 0]), 3: np.array([-1.0, 0, 0, 4.0])}
    in_room = {k: plane + np.array([0, 0, 0, 2.0 * plane[0] + plane[1]]) for k, plane in planes.items()}
    scene = Scene(SCENE.graph, {}, [RoomNode(5, np.eye(4), in_room)], {5: "r"})
    found = room_anchors(scene, {("r", "A"): planes, ("r", "B"): {1: planes[1]}, ("q", "C"): planes}, 1.5)
    assert found[5][:3, 3] == pytest.approx([2.0, 1.0, 1.5])
    assert room_anchors(scene, {("r", "A"): {k: planes[k] for k in (1, 3)}}, 1.5) == {}
    assert room_anchors(scene, {("q", "C"): planes}, 1.5) == {}
