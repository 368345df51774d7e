"""Free-space conflict of two maps of one place, and of similar places."""

import numpy as np
import pytest

from data import Room, SceneGraph, WallSurface
from data.geometry import se2
from sgslam.anchoring.free_space_conflict import conflict_share


def a_room(
    name: str, x: float, y: float, width: float, depth: float, step: float = 0.0
) -> tuple[Room, list[WallSurface]]:
    """A room with a corner at (x, y); its right wall stands `step` metres inside."""
    right = x + width - step
    walls = [
        ((x + width / 2, y), (0.0, 1.0), width), ((x + width / 2, y + depth), (0.0, -1.0), width),
        ((x, y + depth / 2), (1.0, 0.0), depth), ((right, y + depth / 2), (-1.0, 0.0), depth),
    ]  # fmt: skip
    outline = ((x, y), (right, y), (right, y + depth), (x, y + depth))
    room = Room(name, (x + width / 2, y + depth / 2), None, polygon=outline)
    return room, [WallSurface(f"{name}/{k}", name, c, n, length) for k, (c, n, length) in enumerate(walls)]


def graph(*rooms: tuple[Room, list[WallSurface]], T: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SceneGraph:
    """A map of rooms, moved by T."""
    def moved(point: tuple[float, float]) -> tuple[float, float]:
        x, y = se2.apply(np.array(T), np.array(point)).tolist()
        return x, y

    def turned(normal: tuple[float, float]) -> tuple[float, float]:
        x, y = se2.rotate(T[0], np.array(normal)).tolist()
        return x, y

    walls = [wall for _, own in rooms for wall in own]
    return SceneGraph(
        "map",
        tuple(Room(r.id, moved(r.centroid), None, polygon=tuple(map(moved, r.polygon or ()))) for r, _ in rooms),
        tuple(WallSurface(w.id, w.room, moved(w.centroid), turned(w.normal), w.length) for w in walls),
    )  # fmt: skip


OFFICE, HALL = a_room("office", 0, 0, 4, 3), a_room("hall", 4.1, 0, 7, 3)


def test_two_maps_of_one_place_agree_wherever_they_lie() -> None:
    T_a_s = (2.1, 30.0, -7.0)
    assert conflict_share(graph(OFFICE, HALL), graph(OFFICE, HALL), np.zeros(3)) == 0.0
    assert conflict_share(graph(OFFICE, HALL), graph(OFFICE, HALL, T=T_a_s), np.array(T_a_s)) == 0.0


def test_parts_that_only_one_map_has_are_no_conflict() -> None:
    assert conflict_share(graph(OFFICE, HALL), graph(OFFICE), np.zeros(3)) == 0.0
    assert conflict_share(graph(OFFICE), graph(OFFICE, HALL), np.zeros(3)) == 0.0


@pytest.mark.parametrize("swapped", [False, True])
def test_a_wall_in_the_free_space_of_the_other_is_a_conflict(swapped: bool) -> None:
    shorter = a_room("hall", 4.1, 0, 7, 3, step=2.0)
    one, other = graph(OFFICE, HALL), graph(OFFICE, shorter)
    share = conflict_share(*((other, one) if swapped else (one, other)), np.zeros(3))
    assert share == pytest.approx(2.4 / 60, abs=0.02) and share > 0.02


def test_maps_with_nothing_in_common_have_full_conflict() -> None:
    assert conflict_share(graph(OFFICE), graph(HALL, T=(0.0, 50.0, 0.0)), np.zeros(3)) == 1.0
    assert conflict_share(graph(), graph(OFFICE), np.zeros(3)) == 1.0


@pytest.mark.parametrize(
    ("x", "heading", "conflicts"),
    [
        (4.0, 0.0, True), (0.31, 0.0, True), (0.29, 0.0, False), (0.19, 0.0, False),  # from 0.3 m inside the outline on
        (5.19, 0.0, False), (5.21, 0.0, True), (5.19, 20.0, True), (5.19, 17.0, False),  # a wall that the other map has
    ],
)  # fmt: skip
def test_a_wall_within_free_space_conflicts_unless_the_other_map_has_it_too(
    x: float, heading: float, conflicts: bool
) -> None:
    room, walls = a_room("hall", 0, 0, 8, 6)
    inner = WallSurface("inner", "hall", (5.0, 3.0), (1.0, 0.0), 2.0)
    yaw = np.radians(heading)
    seen = WallSurface("seen", "hall", (x, 3.0), (float(np.cos(yaw)), float(np.sin(yaw))), 0.2)
    share = conflict_share(graph((room, [*walls, seen, inner])), graph((room, [*walls, inner])), np.zeros(3))
    assert (share > 0) is conflicts


def test_walls_count_by_their_length_and_those_of_unknown_length_do_not() -> None:
    room, walls = a_room("hall", 0, 0, 8, 6)
    known = graph((room, walls))
    unknown = WallSurface("unknown", "hall", (4.0, 3.0), (1.0, 0.0), None)
    assert conflict_share(graph((room, [*walls, unknown])), known, np.zeros(3)) == 0.0
    screen = WallSurface("screen", "hall", (4.0, 3.0), (1.0, 0.0), 2.0)
    at = 2 * 140  # places on the walls of both maps, every 0.2 m
    assert conflict_share(graph((room, [*walls, screen])), known, np.zeros(3)) == pytest.approx(10 / (at + 10))
    bare = graph((Room("hall", room.centroid), [*walls, screen]))
    assert conflict_share(bare, known, np.zeros(3)) == pytest.approx(10 / (at + 10))
    assert conflict_share(known, bare, np.zeros(3)) == pytest.approx(10 / (at + 10))
    assert conflict_share(bare, graph((Room("hall", room.centroid), walls)), np.zeros(3)) == 0.0  # nothing is free
