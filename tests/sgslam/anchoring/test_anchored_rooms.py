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


def test_statuses_say_why_a_wall_anchors_the_map() -> None:
    tight, loose = wall("r", "A"), wall("r", "A", off=-0.1)
    for walls, state, why in (
        ((tight,), "tight", "as planned within 30 mm"),
        ((loose,), "loose", "-100 mm off the plan"),
        ((tight, loose), "tight", "as planned"),  # two pieces of one wall at one planned surface
        ((loose, tight), "tight", "as planned"),
    ):
        found = anchor_statuses(of(*walls), SCENE, "match 3")[7, "a"]
        assert (found.state, found.by) == (state, "match 3") and found.why.startswith(why)


def anchored(*walls: AlignedWall) -> dict[int, list[PlannedWall]]:
    """In a local frame whose origin is at y = 3 m, in which the map lies 5 m high."""
    return planned_walls(of(*walls), SCENE, pose(0.0, 0.0, 5.0), np.array([0.0, 3.0, 0.0]))


def test_all_walls_are_anchored_at_their_planned_planes() -> None:
    found = anchored(wall("r", "A", off=0.1), wall(None, "A", ids="td"))
    assert {w: [p.a_id for p in planned] for w, planned in found.items()} == {7: ["a"], 8: ["d"]}
    assert found[7][0].plane == pytest.approx([0.0, 1.0, 0.0, 3.0])
    assert found[7][0].place == pytest.approx([1.0, 0.0, 6.0])


def test_a_room_is_anchored_by_agreeing_walls_of_two_directions_in_one_planned_room() -> None:
    """The room's origin is at (2, 1) in the plan, whose local frame is 3 m aside."""
    origin, sides = np.array([3.0, 0.0, 0.0]), {"t": (0.0, 1.0), "u": (1.0, 0.0), "v": (0.0, -1.0)}
    seen = {k: replace(SEEN, id=k, normal=normal) for k, normal in sides.items()}
    planned = {k: replace(PLANNED, id=k, normal=normal, centroid=(5.0, 1.0)) for k, normal in sides.items()}
    in_room = {k: np.array([*normal, 0.0, 0.0]) for k, normal in enumerate(sides.values())}
    scene = Scene(SCENE.graph, {k: n for n, k in enumerate(sides)}, [RoomNode(5, np.eye(4), in_room)], {5: "r"})

    def rooms(ids: str, room: str | None = "r", a_room: str | None = "A", off: float = 0.0) -> list[AlignedWall]:
        return [AlignedWall(replace(seen[k], room=room), replace(planned[k], room=a_room), off, not off) for k in ids]

    def found(*walls: AlignedWall) -> list[NDArray[np.float64]]:
        return [T[:3, 3] for T in room_anchors(of(*walls), scene, origin, 1.5).values()]

    assert found(*rooms("tuv"), *rooms("t", a_room="B"))[0] == pytest.approx([2.0, 1.0, 1.5])
    assert found(*rooms("tu"), *rooms("v", off=0.1))[0] == pytest.approx([2.0, 1.0, 1.5])
    for walls in (
        rooms("tv"),  # of one direction
        rooms("tuv", room="q"),
        rooms("tuv", room=None),
        rooms("tuv", a_room=None),
        rooms("tuv", off=0.1),
        [*rooms("t"), *rooms("u", a_room="B")],
    ):
        assert not found(*walls)
