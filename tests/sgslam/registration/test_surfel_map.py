"""The surfel map: sides of walls, cells of several sizes, forgetting; and the normals that a scan itself shows."""

from typing import Any

import numpy as np
import pytest
from boxes import Array

from sgslam.registration.sampling import normals_at
from sgslam.surfels import SurfelMap
from sgslam.surfels.search import nearest_plane

AHEAD = np.array([1.0, 0.0, 0.0])
BELOW = np.array([-1.8, 0.0, -1.0])  # to the sensor from a point high on the wall


def wall(x: float, noise: float = 0.01, seed: int = 0, points: int = 4000) -> Array:
    """(N, 3) points of a wall at x, 4 m wide and 2 m high."""
    rng = np.random.default_rng(seed)
    return np.c_[x + rng.normal(0, noise, points), rng.uniform(-2, 2, points), rng.uniform(0, 2, points)]


def known(*seen: tuple[Array, Array]) -> SurfelMap:
    """Points, each with the ray along which they are seen."""
    surfels = SurfelMap()
    for points, ray in seen:
        surfels.add(points, np.tile(ray, (len(points), 1)), 0.0, 100.0)
    return surfels


def nearest(
    point: tuple[float, float, float],
    surfels: SurfelMap,
    to_sensor: Array = -AHEAD,
    way: float = 0.0,
    error: float = 0.0,
    normal: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Array | None:
    """The plane nearest to a point, known to an error and with a normal, that a sensor sees from a way off."""
    at = np.array(point)
    found = nearest_plane(at, at + to_sensor, np.array(normal), 1.2, error, surfels.arrays, way - 100.0)
    return None if found < 0 else surfels.arrays.planes[found]


@pytest.mark.parametrize("seed", range(3))
def test_each_side_of_a_thin_wall_has_its_own_surfels(seed: int) -> None:
    surfels = known((wall(2.1, seed=seed), AHEAD), (wall(2.2, seed=seed + 9), -AHEAD))
    for x, ray in ((2.1, AHEAD), (2.2, -AHEAD)):
        plane = nearest((2.15, 0.3, 1.2), surfels, -ray)
        assert plane is not None and plane[:3] @ ray < -0.99 and plane[3] == pytest.approx(x, abs=0.01)


def test_a_step_within_a_large_cell_is_known_by_the_small_ones() -> None:
    points = wall(2.3, 0.005)
    points[points[:, 1] > 0.5, 0] += 0.1
    plane = nearest((2.3, 0.3, 1.2), known((points, AHEAD)))
    assert plane is not None and plane[3] == pytest.approx(2.3, abs=0.005) and abs(plane[0]) > 0.999


@pytest.mark.parametrize(
    ("point", "options", "is_known"),
    [
        ((2.4, 0.3, 1.2), {"way": 99.0}, True),
        ((2.4, 0.3, 1.2), {"way": 101.0}, False),  # forgotten
        ((2.6, 0.3, 1.2), {"to_sensor": -0.25 * AHEAD}, True),
        ((2.6, 0.3, 1.2), {"to_sensor": -0.15 * AHEAD}, False),  # from behind; a far edge may lie in that direction
        ((2.4, 0.3, 1.4), {}, True),
        ((2.4, 0.3, 1.8), {}, False),  # beyond where the wall was seen
        ((2.4, 0.3, 1.8), {"error": 0.3}, True),
    ],
)
def test_a_plane_is_known_where_and_from_where_it_was_seen(
    point: tuple[float, float, float], options: dict[str, Any], is_known: bool
) -> None:
    points = wall(2.4)
    surfels = known((points[points[:, 2] < 1.5] if point[2] > 1.3 else points, AHEAD))
    assert (nearest(point, surfels, **options) is not None) == is_known


@pytest.mark.parametrize(
    ("point", "normal", "expected"),
    [
        (
            (2.39, 0.3, 1.92),
            None,
            "wall",
        ),  # off the ceiling, in the cell above, which has a strip of the wall
        ((2.39, 0.3, 2.15), None, "ceiling"),  # more than a hand's breadth beyond the wall's cell
        # what fits both is on neither
        ((2.40, 0.3, 1.985), None, None),
        ((2.39, 0.3, 1.985), None, None),
        ((2.37, 0.3, 1.985), None, "ceiling"),
        ((2.10, 0.3, 1.985), None, "ceiling"),
        # unless the scan shows the normal
        ((2.39, 0.3, 1.985), (0.0, 0.0, 1.0), "ceiling"),
        ((2.39, 0.3, 1.84), (1.0, 0.0, 0.0), "wall"),
    ],
)
def test_a_wall_goes_on_beyond_its_cell_below_a_ceiling(
    point: tuple[float, float, float], normal: tuple[float, float, float] | None, expected: str | None
) -> None:
    """A wall at x = 2.4 m, seen up to a height of 1.85 m, and the ceiling at 2 m."""
    rng, points = np.random.default_rng(0), wall(2.4, 0.005)
    ceiling = np.c_[rng.uniform(1, 2.4, 4000), rng.uniform(-2, 2, 4000), 2.0 + rng.normal(0, 0.005, 4000)]
    surfels = known((points[points[:, 2] < 1.85], AHEAD), (ceiling, np.array([0.8, 0.0, 0.6])))
    plane = nearest(point, surfels, BELOW, normal=normal or (0.0, 0.0, 0.0))
    found = None if plane is None else {0: "wall", 2: "ceiling"}[int(np.argmax(np.abs(plane[:3]) > 0.99))]
    assert found == expected


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("elevations_deg", "below", "shown"), [([15.0], 0.0, False), ([11.5, 13.5, 15.5], 0.51, True)])
def test_rings_a_hand_apart_show_the_wall_and_one_ring_no_normal(
    elevations_deg: list[float], below: float, shown: bool, seed: int
) -> None:
    """The points of one spread along their rays by noise, and so do not show the cone that they lie on."""
    rng, azimuth, found = np.random.default_rng(seed), np.linspace(0.01, 0.23, 40) / 2.6, []
    for elevation in np.radians(elevations_deg):
        ray = np.c_[np.ones(40), np.tan(azimuth), np.full(40, np.tan(elevation)) / np.cos(azimuth)]
        found.append(ray * (2.6 + rng.normal(0, 0.02, (40, 1))))
    points = np.concatenate(found) - [0.0, 0.0, below]
    normals = normals_at(points, np.arange(len(points)), 0.25)
    some = normals[np.abs(normals).any(axis=1)]
    assert len(some) > 0.5 * len(points) if shown else not len(some)
    assert (np.abs(some[:, 0]) > 0.9).all()
