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
