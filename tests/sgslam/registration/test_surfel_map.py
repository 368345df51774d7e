"""The surfel map: sides of walls, cells of several sizes, forgetting."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sgslam.surfels import SurfelMap
from sgslam.surfels.search import nearest_plane

Array = NDArray[np.float64]
_AHEAD = np.array([1.0, 0.0, 0.0])


def _wall(x: float, noise: float, seed: int, points: int = 4000) -> Array:
    """(N, 3) points of a wall at x, 4 m wide and 2 m high."""
    rng = np.random.default_rng(seed)
    return np.c_[x + rng.normal(0, noise, points), rng.uniform(-2, 2, points), rng.uniform(0, 2, points)]


def _added(surfels: SurfelMap, points: Array, ray: Array, way: float = 0.0) -> None:
    surfels.add(points, np.tile(ray, (len(points), 1)), way, 100.0)


def _nearest(
    point: tuple[float, float, float], to_sensor: Array, surfels: SurfelMap, way: float = 0.0, error: float = 0.0
) -> int:
    """The plane nearest to a point, known to an error, that a sensor sees from a way off."""
    at = np.array(point)
    return nearest_plane(at, at + to_sensor, np.zeros(3), 1.2, error, surfels.arrays, way - 100.0)


@pytest.mark.parametrize("seed", range(3))
def test_each_side_of_a_thin_wall_has_its_own_surfels(seed: int) -> None:
    surfels = SurfelMap()
    _added(surfels, _wall(2.1, 0.01, seed), _AHEAD)
    _added(surfels, _wall(2.2, 0.01, seed + 9), -_AHEAD)
    for x, ray in ((2.1, _AHEAD), (2.2, -_AHEAD)):
        found = _nearest((2.15, 0.3, 1.2), -ray, surfels)
        plane = surfels.arrays.planes[found]
        assert plane[:3] @ ray < -0.99
        assert plane[3] == pytest.approx(x, abs=0.01)


def test_a_step_within_a_large_cell_is_known_by_the_small_ones() -> None:
    surfels = SurfelMap()
    points = _wall(2.3, 0.005, 0)
    points[points[:, 1] > 0.5, 0] += 0.1
    _added(surfels, points, _AHEAD)
    found = _nearest((2.3, 0.3, 1.2), -_AHEAD, surfels)
    plane = surfels.arrays.planes[found]
    assert plane[3] == pytest.approx(2.3, abs=0.005)
    assert abs(plane[0]) > 0.999


@pytest.mark.parametrize(("way", "known"), [(99.0, True), (101.0, False)])
def test_surfels_are_forgotten_after_a_way(way: float, known: bool) -> None:
    surfels = SurfelMap()
    _added(surfels, _wall(2.4, 0.01, 0), _AHEAD)
    assert (_nearest((2.4, 0.3, 1.2), -_AHEAD, surfels, way) >= 0) == known


@pytest.mark.parametrize(("stands", "known"), [(-0.05, True), (0.05, False)])
def test_a_plane_is_not_seen_from_behind(stands: float, known: bool) -> None:
    """Over its far edge a point may lie in the direction from which it was seen."""
    surfels = SurfelMap()
    _added(surfels, _wall(2.4, 0.01, 0), _AHEAD)
    assert (_nearest((2.6, 0.3, 1.2), np.array([stands - 0.2, 0.0, 0.0]), surfels) >= 0) == known


@pytest.mark.parametrize(("beyond", "error", "known"), [(-0.1, 0.0, True), (0.3, 0.0, False), (0.3, 0.3, True)])
def test_a_plane_ends_where_it_was_seen(beyond: float, error: float, known: bool) -> None:
    surfels = SurfelMap()
    points = _wall(2.4, 0.01, 0)
    _added(surfels, points[points[:, 2] < 1.5], _AHEAD)
    assert (_nearest((2.4, 0.3, 1.5 + beyond), -_AHEAD, surfels, error=error) >= 0) == known


def _below_a_ceiling() -> SurfelMap:
    """A wall at x = 2.4 m, seen up to a height of 1.85 m, and the ceiling at 2 m."""
    surfels, rng = SurfelMap(), np.random.default_rng(0)
    wall = _wall(2.4, 0.005, 0)
    _added(surfels, wall[wall[:, 2] < 1.85], _AHEAD)
    ceiling = np.c_[rng.uniform(1, 2.4, 4000), rng.uniform(-2, 2, 4000), 2.0 + rng.normal(0, 0.005, 4000)]
    _added(surfels, ceiling, np.array([0.8, 0.0, 0.6]))
    return surfels


@pytest.mark.parametrize(
    ("height", "is_on_wall"),
    [
        (1.92, True),  # off the ceiling, in the cell above the wall's, which has only a strip of it
        (2.15, False),  # more than a hand's breadth beyond the wall's cell
    ],
)
def test_a_wall_goes_on_beyond_its_cell_below_a_ceiling(height: float, is_on_wall: bool) -> None:
    surfels = _below_a_ceiling()
    found = _nearest((2.39, 0.3, height), np.array([-1.8, 0.0, -1.0]), surfels)
    assert abs(surfels.arrays.planes[found, 0 if is_on_wall else 2]) > 0.99


@pytest.mark.parametrize(("off_the_wall", "known"), [(0.0, False), (0.01, False), (0.03, True), (0.3, True)])
def test_a_point_that_fits_a_ceiling_and_the_wall_below_it_is_on_neither(off_the_wall: float, known: bool) -> None:
    surfels = _below_a_ceiling()
    found = _nearest((2.4 - off_the_wall, 0.3, 1.985), np.array([-1.8, 0.0, -1.0]), surfels)
    assert (found >= 0) == known
    assert not known or surfels.arrays.planes[found, 2] < -0.99


@pytest.mark.parametrize(("normal", "column"), [((0.0, 0.0, 1.0), 2), ((1.0, 0.0, 0.0), 0)])
def test_where_the_scan_shows_the_normal_the_surface_is_known(
    normal: tuple[float, float, float], column: int
) -> None:  # fmt: skip
    surfels = _below_a_ceiling()
    at = np.array([2.39, 0.3, 1.985 if column else 1.84])
    sensor = at + np.array([-1.8, 0.0, -1.0])
    found = nearest_plane(at, sensor, np.array(normal), 1.2, 0.0, surfels.arrays, -100.0)
    assert abs(surfels.arrays.planes[found, column]) > 0.99
