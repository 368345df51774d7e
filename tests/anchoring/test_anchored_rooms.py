"""Which anchors aligned walls become: their grades, and the rooms that follow from them."""

from dataclasses import replace

import numpy as np
import pytest

from data import Room, SceneGraph, WallSurface
from sgslam.anchoring.anchored_rooms import GradedWalls, anchor_statuses, graded_walls, matched_rooms, room_anchors
from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment
from sgslam.mapping import Scene
from sgslam.mapping.graph_nodes import RoomNode

GATE = 0.03
SEEN = WallSurface("s", "r", (1.0, 0.0), (0.0, 1.0), 2.0, height=(0.0, 2.0))
PLANNED = WallSurface("a", "A", (1.0, 0.0), (0.0, 1.0), 2.0)
SCENE = Scene(SceneGraph("map", (Room("r", (1.0, 1.0)),), (SEEN,)), {"s": 7, "t": 8}, [], {})


def wall(
    room: str | None, planned: str | None, length: float | None = 2.0, offset: float = 0.0, agrees: bool = True,
    drifted: bool = False, ids: tuple[str, str] = ("s", "a"),
) -> AlignedWall:  # fmt: skip
    seen = replace(SEEN, id=ids[0], room=room, length=length)
    return AlignedWall(seen, replace(PLANNED, id=ids[1], room=planned), offset, agrees, drifted)


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
        (wall("r", "A", agrees=False, drifted=True, offset=0.1), "tight", "+100 mm off, like all walls around it"),
        (wall("r", "A", agrees=False, offset=-0.1), "loose", "-100 mm off the plan"),
    ):
        for matched, by in ((pair, "match 3"), (set(), "position")):
            found = anchor_statuses(of(aligned), SCENE, matched, "match 3")[7, "a"]
            assert (found.state, found.by) == (status, by) and found.why.startswith(why)
    tight, loose = wall("r", "A"), wall("r", "A", agrees=False, offset=0.1)
    for walls in ((tight, loose), (loose, tight)):  # two pieces of one wall at one planned surface
        assert anchor_statuses(of(*walls), SCENE, pair, "match 3")[7, "a"].state == "tight"


def graded(*walls: AlignedWall) -> GradedWalls:
    alignment = of(*walls)
    statuses = anchor_statuses(alignment, SCENE, set(), "match 1")
    return graded_walls(alignment, SCENE, statuses, np.eye(4), np.zeros(3))


@pytest.mark.parametrize(
    ("aligned", "grade"),
    [
        (wall("r", "A"), "tight"), (wall("r", "A", offset=0.1, agrees=False, drifted=True), "drifted"),
        (wall("r", "A", offset=0.03, agrees=False), "loose"), (wall("r", "A", offset=-0.3, agrees=False), "loose"),
    ],
)  # fmt: skip
def test_a_wall_is_graded_by_what_the_walls_around_it_tell(aligned: AlignedWall, grade: str) -> None:
    found = graded(aligned)
    grades = dict(zip(("tight", "drifted", "loose"), found.lists(), strict=True))
    assert {name for name, walls in grades.items() if walls} == {grade} and list(grades[grade]) == [7]
    assert bool(found.by_rooms) == (grade != "loose")
    assert not graded(replace(aligned, surface=replace(aligned.surface, room=None))).by_rooms
    assert not graded(replace(aligned, planned=replace(aligned.planned, room=None))).by_rooms


def test_a_wall_is_in_its_best_grade_only() -> None:
    tight = wall("r", "A")
    drifted = wall("r", "A", offset=0.1, agrees=False, drifted=True, ids=("s", "b"))
    loose = wall("r", "A", offset=0.2, agrees=False, ids=("s", "c"))
    other = wall("r", "A", offset=0.2, agrees=False, ids=("t", "d"))
    assert [sorted(walls) for walls in graded(tight, drifted, loose, other).lists()] == [[7], [], [8]]
    assert [sorted(walls) for walls in graded(drifted, loose, other).lists()] == [[], [7], [8]]


def test_the_plane_of_a_planned_wall_is_in_the_local_frame() -> None:
    alignment = of(wall("r", "A"))
    statuses = anchor_statuses(alignment, SCENE, set(), "match 1")
    T_local_level = np.eye(4)
    T_local_level[2, 3] = 5.0
    found = graded_walls(alignment, SCENE, statuses, T_local_level, np.array([0.0, 3.0, 0.0])).tight[7]["a"]
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
