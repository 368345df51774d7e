"""Free-space conflict of two maps of one place, and of similar places."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, box, merged

from data import SceneGraph, WallSurface
from data.scene_graph.graph import moved
from sgslam.anchoring.free_space_conflict import conflict_share

OFFICE, HALL = a_graph([box(0, 0, 4, 3)], prefix="office"), a_graph([box(4.1, 0, 7, 3)], prefix="hall")
BOTH, SHORTER = merged(OFFICE, HALL), merged(OFFICE, a_graph([box(4.1, 0, 5, 3)], prefix="hall"))
HERE, THERE = np.zeros(3), np.array([2.1, 30.0, -7.0])
WIDE = a_graph([box(0, 0, 8, 6)], prefix="hall")


def with_screens(room: SceneGraph, *screens: tuple[float, float | None, float]) -> SceneGraph:
    """The room and walls in it, 3 m up: their x, length and heading (degrees)."""
    own = [
        WallSurface(f"s{k}", None, (x, 3.0), (float(np.cos(h)), float(np.sin(h))), length)
        for k, (x, length, h) in enumerate((x, length, np.radians(degrees)) for x, length, degrees in screens)
    ]
    return SceneGraph("map", room.rooms, (*room.wall_surfaces, *own))


@pytest.mark.parametrize(
    ("s", "a", "T_a_s", "share"),
    [
        (BOTH, BOTH, HERE, 0.0),
        (BOTH, moved(BOTH, THERE), THERE, 0.0),
        (BOTH, OFFICE, HERE, 0.0),  # what only one of them has is no conflict
        (OFFICE, BOTH, HERE, 0.0),
        (BOTH, SHORTER, HERE, 0.04),  # a wall of 3 m in the free space of the other
        (SHORTER, BOTH, HERE, 0.04),
        (OFFICE, moved(HALL, np.array([0.0, 0.0, 50.0])), HERE, 1.0),
        (SceneGraph("map", (), ()), OFFICE, HERE, 1.0),
    ],
)
def test_walls_in_the_free_space_of_the_other_map_conflict(
    s: SceneGraph, a: SceneGraph, T_a_s: np.ndarray, share: float
) -> None:
    assert conflict_share(s, a, T_a_s) == pytest.approx(share, abs=0.01 if 0 < share < 1 else 0.0)


@pytest.mark.parametrize(
    ("conflicting", "others"),  # x and heading
    [
        ([(4.0, 0.0), (0.31, 0.0)], [(0.29, 0.0), (0.19, 0.0)]),  # from 0.3 m inside the outline on
        ([(5.21, 0.0), (5.19, 20.0)], [(5.19, 0.0), (5.19, 17.0)]),  # a wall that the other map has
    ],
)
def test_a_wall_within_free_space_conflicts_unless_the_other_map_has_it_too(
    conflicting: list[tuple[float, float]], others: list[tuple[float, float]]
) -> None:
    inner = (5.0, 2.0, 0.0)
    for x, heading in (*conflicting, *others):
        share = conflict_share(with_screens(WIDE, inner, (x, 0.2, heading)), with_screens(WIDE, inner), HERE)
        assert (share > 0) is ((x, heading) in conflicting)


def test_walls_count_by_their_length_and_those_of_unknown_length_do_not() -> None:
    assert conflict_share(with_screens(WIDE, (4.0, None, 0.0)), WIDE, HERE) == 0.0
    at, screened = 2 * 140, with_screens(WIDE, (4.0, 2.0, 0.0))  # places on the walls of both maps, every 0.2 m
    bare, bare_screened = (replace(g, rooms=(replace(g.rooms[0], polygon=None),)) for g in (WIDE, screened))
    for s, a in ((screened, WIDE), (bare_screened, WIDE), (WIDE, bare_screened)):
        assert conflict_share(s, a, HERE) == pytest.approx(10 / (at + 10))
    assert conflict_share(bare_screened, bare, HERE) == 0.0  # nothing is free
