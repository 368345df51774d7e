"""What points tell of the sensor's place: all of them together no more than their plane is one."""

import multiprocessing

import numpy as np
import pytest
from boxes import Array

from sgslam.registration.correspondences import planes_of
from sgslam.registration.motion_prior import add_height
from sgslam.registration.point_to_plane import add_points
from sgslam.surfels import SurfelMap
from sgslam.tracking.level_frame import add_seen

HEIGHT = 1.5  # m, of the sensor above the floor


def floor(rough: float, count: int, seed: int) -> Array:
    """(N, 3) points on a floor, seen from above; at its edge something stands on it, up to so many metres high."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-4, 4, (count, 2)), rng.normal(-HEIGHT, 0.01, count)])
    points[:, 2] += rough * rng.uniform(0, 1, count) * (points[:, 0] > 1.5)
    return points


def known(rough: float, seed: int) -> SurfelMap:
    surfels = SurfelMap()
    add_seen(surfels, floor(rough, 12800, seed), np.eye(4))
    return surfels


def matched(points: Array, surfels: SurfelMap, error: float) -> tuple[Array, ...]:
    """The points, their planes, knots and shares, for one knot."""
    knot, share = np.zeros(len(points), np.int64), np.zeros(len(points))
    both = np.hstack([points, np.zeros((len(points), 3))])
    return *planes_of(both, knot, share, np.eye(4)[None], surfels.arrays, -1.0, 1.2, error), knot, share


def told(rough: float, error: float, seed: int, per_cell: int = 40) -> float:
    """The information about the height that new points tell at that edge."""
    surfels = known(rough, seed)
    points, rest = floor(rough, 64 * per_cell, seed + 1), floor(rough, 128 * per_cell, seed + 2)
    points, rest = points[points[:, 0] > 2], rest[rest[:, 0] < 1]  # most planes are flat
    total = []
    for chosen in (np.vstack([points, rest]), rest):
        H, g, F = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
        moved, plane_of, knot, share = matched(chosen, surfels, error)
        options = (error, 0.1 + error, 0.1**2, 0.1, 0)
        add_points(moved, plane_of, knot, share, np.eye(4)[None], surfels.planes, *options, H, g, F)
        total.append(float(H[5, 5]))
    return total[0] - total[1]


@pytest.mark.parametrize("seed", range(2))
def test_a_plane_that_is_not_flat_tells_little_however_many_points_it_has(seed: int) -> None:
    rough, flat = told(0.15, 0.0, seed), told(0.0, 0.0, seed)
    assert rough < 0.25 * flat
    assert told(0.15, 0.0, seed, 160) < 2 * rough and told(0.0, 0.0, seed, 160) > 3.4 * flat
    assert told(0.15, 0.5, seed) > 0.8 * told(0.0, 0.5, seed)  # while the pose is poor, all points count


@pytest.mark.parametrize(("off", "variance", "is_drawn"), [(0.05, 0.0, True), (0.5, 0.0, False), (0.5, 0.3**2, True)])
def test_only_a_known_height_is_taken_for_a_climb(off: float, variance: float, is_drawn: bool) -> None:
    """A sensor above its usual height, which is known to a variance (m2), is drawn back unless it climbs."""
    knots, H, g = np.eye(4)[None].copy(), np.zeros((6, 6)), np.zeros(6)
    knots[0, 2, 3] = off
    add_height(knots, np.array([0.0, 0, 1]), 0.0, variance, 0.05, 0.1, H, g)
    assert g[5] > 1.2 if is_drawn else abs(g[5]) < 0.1


def planes_found(count: int) -> list[int]:
    """The planes of so many points of a known floor."""
    return [int(plane) for plane in matched(floor(0.0, 12800, 0)[:count], known(0.0, 0), 0.0)[1]]


def test_each_point_has_its_plane_whatever_their_number_and_after_a_fork() -> None:
    every = planes_found(100)
    assert [planes_found(count) for count in (0, 1, 2, 7)] == [every[:0], every[:1], every[:2], every[:7]]
    with multiprocessing.get_context("fork").Pool(1) as forked:
        assert forked.apply_async(planes_found, (100,)).get(timeout=60) == every
