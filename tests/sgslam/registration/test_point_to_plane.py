"""What points tell of the sensor's place: all of them together no more than their plane is one."""

import multiprocessing

import numpy as np
import pytest
from numpy.typing import NDArray

from sgslam.registration.correspondences import planes_of
from sgslam.registration.motion_prior import add_height
from sgslam.registration.point_to_plane import add_points
from sgslam.surfels import SurfelMap

Floats = NDArray[np.float64]
HEIGHT = 1.5  # m, of the sensor above the floor
KERNEL = 0.1  # m


def floor(rough: float, count: int, seed: int) -> Floats:
    """(N, 3) points on a floor, seen from above; at its edge something stands on it, up to so many metres high."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-4, 4, (count, 2)), rng.normal(-HEIGHT, 0.01, count)])
    points[:, 2] += rough * rng.uniform(0, 1, count) * (points[:, 0] > 1.5)
    return points


def told(rough: float, error: float, seed: int, per_cell: int = 40) -> float:
    """The information about the height that new points tell at that edge."""
    known = floor(rough, 12800, seed)
    surfels = SurfelMap()
    surfels.add(known, known / np.linalg.norm(known, axis=1)[:, None], 0.0, 100.0)
    points = floor(rough, 64 * per_cell, seed + 1)
    points = points[points[:, 0] > 2]
    rest = floor(rough, 128 * per_cell, seed + 2)  # most planes are flat
    rest = rest[rest[:, 0] < 1]
    both = np.hstack([np.vstack([points, rest]), np.zeros((len(points) + len(rest), 3))])
    H, g, F = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
    own = np.arange(len(both)) < len(points)
    total = []
    for chosen in (np.ones(len(both), bool), ~own):
        H[:], g[:], F[:] = 0, 0, 0
        chosen_points = both[chosen]
        knot, share, knots = np.zeros(len(chosen_points), np.int64), np.zeros(len(chosen_points)), np.eye(4)[None]
        moved, plane_of = planes_of(chosen_points, knot, share, knots, surfels.arrays, -1.0, 1.2, error)
        add_points(moved, plane_of, knot, share, knots, surfels.planes, error, KERNEL + error, 0.1**2, 0.1, 0, H, g, F)
        total.append(float(H[5, 5]))
    return total[0] - total[1]


@pytest.mark.parametrize("seed", range(3))
def test_a_plane_that_is_not_flat_tells_little(seed: int) -> None:
    assert told(0.15, 0.0, seed) < 0.25 * told(0.0, 0.0, seed)


@pytest.mark.parametrize("seed", range(3))
def test_more_points_on_it_tell_hardly_more(seed: int) -> None:
    assert told(0.15, 0.0, seed, 160) < 2 * told(0.15, 0.0, seed)
    assert told(0.0, 0.0, seed, 160) > 3.4 * told(0.0, 0.0, seed)


@pytest.mark.parametrize("seed", range(3))
def test_while_the_pose_is_poor_all_points_count(seed: int) -> None:
    assert told(0.15, 0.5, seed) > 0.8 * told(0.0, 0.5, seed)


def height_pull(off: float, variance: float) -> float:
    """How much a sensor so many metres above its usual height is drawn back, its height known to a variance (m2)."""
    knots, H, g = np.eye(4)[None].copy(), np.zeros((6, 6)), np.zeros(6)
    knots[0, 2, 3] = off
    add_height(knots, np.array([0.0, 0, 1]), 0.0, variance, 0.05, 0.1, H, g)
    return float(g[5])


def test_only_a_known_height_is_taken_for_a_climb() -> None:
    assert height_pull(0.05, 0.0) > 1.2
    assert height_pull(0.5, 0.0) < 0.1
    assert height_pull(0.5, 0.3**2) > 1.2


def planes_found(count: int) -> list[int]:
    """The planes of so many points of a known floor."""
    known = floor(0.0, 12800, 0)
    surfels = SurfelMap()
    surfels.add(known, known / np.linalg.norm(known, axis=1)[:, None], 0.0, 100.0)
    points = np.hstack([known[:count], np.zeros((count, 3))])
    knot, share = np.zeros(count, np.int64), np.zeros(count)
    return [int(s) for s in planes_of(points, knot, share, np.eye(4)[None], surfels.arrays, -1.0, 1.2, 0.0)[1]]


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_each_point_has_its_plane_whatever_their_number(count: int) -> None:
    assert planes_found(count) == planes_found(100)[:count]


def test_planes_are_found_after_a_fork() -> None:
    here = planes_found(100)
    with multiprocessing.get_context("fork").Pool(1) as forked:
        assert forked.apply_async(planes_found, (100,)).get(timeout=60) == here
