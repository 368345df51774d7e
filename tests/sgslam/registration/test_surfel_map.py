"""The surfel map: sides of walls, cells, forgetting; what a scan sees through, and what its points tell."""

from typing import Any

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of
from walks import SCAN_NS, surfels_of

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import transform_points
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.health import shares_seen_through
from sgslam.surfels import SurfelMap
from sgslam.surfels.search import nearest_plane

Point = tuple[float, float, float]
AHEAD, NONE = np.array([1.0, 0.0, 0.0]), (0.0, 0.0, 0.0)


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
    point: Point, surfels: SurfelMap, to_sensor: Array = -AHEAD, way: float = 0, error: float = 0, normal: Point = NONE
) -> Array | None:
    """The plane nearest to a point, known to an error and with a normal, that a sensor sees from a way off."""
    x, y, z = np.add(point, to_sensor)
    found = nearest_plane(point, (x, y, z), normal, 1.2, float(error), surfels.arrays, way - 100.0)
    return surfels.arrays.planes[found] if found else None


@pytest.mark.parametrize("seed", range(3))
def test_each_side_of_a_thin_wall_has_its_own_surfels(seed: int) -> None:
    surfels = known((wall(2.1, seed=seed), AHEAD), (wall(2.2, seed=seed + 9), -AHEAD))
    for x, ray in ((2.1, AHEAD), (2.2, -AHEAD)):
        plane = nearest((2.15, 0.3, 1.2), surfels, -ray)
        assert plane is not None and plane[:3] @ ray < -0.99 and plane[3] == pytest.approx(x, abs=0.01)


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
def test_a_plane_is_known_where_it_was_seen(point: Point, options: dict[str, Any], is_known: bool) -> None:
    points = wall(2.4)
    surfels = known((points[points[:, 2] < 1.5] if point[2] > 1.3 else points, AHEAD))
    assert (nearest(point, surfels, **options) is not None) == is_known


SMALL, LARGE = room(-2, -2, 2, 2), room(-4, -4, 4, 4)
LARGER = room(-2, -2, 3.5, 3.5)  # shares two walls and a corner with the small one
HERE = pose(0.3, 0.2, 1.2)


def mapped(boxes: list[Box]) -> SurfelMap:
    """A room as a few scans show it."""
    places = [(0.0, 0.0), (0.5, 0.2), (-0.5, 0.4), (0.2, -0.6)]
    return surfels_of(scene_of(boxes), [pose(x, y, 1.2, 0.3 * k, 0.1 * k) for k, (x, y) in enumerate(places)])


def seen_through(there: list[Box], T: Array, surfels: SurfelMap, beyond: float = -np.inf) -> tuple[float, float]:
    """By a scan, as far as its points have a larger x."""
    points = transform_points(T, scan(scene_of(there), T, seed=9))
    return shares_seen_through(points[points[:, 0] > beyond], T[:3, 3].copy(), surfels.arrays, -1.0)


def test_a_larger_room_is_seen_through_the_walls_of_a_smaller_one() -> None:
    for there, surfels in ((SMALL, SMALL), (LARGE, LARGE), (SMALL, LARGE)):
        assert seen_through(there, HERE, mapped(surfels))[1] < 0.01
    assert seen_through(LARGE, HERE, mapped(SMALL))[1] > 0.2


def test_a_small_wall_is_seen_through_where_most_rays_pass_it_but_a_person_was_none() -> None:
    """Of a long corridor, whose surfaces are many; a person filled as much of the view."""
    limit, corridor, panel = TrackingSettings().seen_through, room(-20, -1, 20, 1), (0.9, -1.0, 0.0, 1.0, 1.0, 2.6)
    of_rays, of_surfaces = seen_through(corridor, pose(0.3, 0.0, 1.2), mapped([*corridor, panel]), beyond=1.6)
    assert of_rays > 0.6 and of_surfaces < limit
    with_person = mapped([*SMALL, (0.35, -0.1, 0.0, 0.85, 0.5, 1.7)])
    assert np.linalg.norm(with_person.surfels()[0] - HERE[:3, 3], axis=1).min() < 0.4
    assert seen_through(SMALL, HERE, with_person)[1] < 0.5 * limit


def opened(width: float) -> list[Box]:
    """The small room, with an opening of a width (m) in one wall to a space behind it."""
    wall = (-2.2, 2, 0, 2.2, 2.2, 2.6)
    pieces: list[Box] = [(-2.2, 2, 0, -width / 2, 2.2, 2.6), (width / 2, 2, 0, 2.2, 2.2, 2.6)]
    return [*(box for box in SMALL if box != wall), *pieces, *room(-2, 2.2, 2, 3.5)[1:]]


@pytest.mark.parametrize(
    ("there", "limit", "scans", "there_lost", "back_lost"),
    [
        # they may have been people who went away; after half a second, they stay seen through
        (LARGER, 0.1, 3, True, False),
        (LARGER, 0.1, 8, True, True),
        (LARGER, 1.0, 1, False, False),  # half of its points are where walls were known
        (opened(1.2), 0.1, 1, False, False),  # a door
        (opened(4.0), 0.1, 1, True, False),
    ],
)
def test_a_room_beyond_the_known_walls_is_another_one(
    there: list[Box], limit: float, scans: int, there_lost: bool, back_lost: bool
) -> None:
    """Eight scans in the small room, some in another one, and one in the first again."""
    odometry, lost, off = ContinuousTimeOdometry(TrackingSettings(seen_through=limit)), [], []
    small, other = scene_of(SMALL), scene_of(there)
    for k in range(8 + scans + 1):
        T = pose(0.05 * k, 0.2, 1.2)
        found = odometry.register(k * SCAN_NS, scan(other if 8 <= k < 8 + scans else small, T, seed=k))
        lost.append(found.health == "lost")
        off.append(abs(found.T_odom_sensor[0, 3] - T[0, 3]))
    assert lost == [*[False] * 8, *[there_lost] * scans, back_lost]
    assert max(off[:11]) < 0.03 and (off[-1] > 0.15 if back_lost else off[-1] < 0.03)
