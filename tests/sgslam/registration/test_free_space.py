"""A scan at a wrong pose sees through known walls; at its own it does not, whatever lies behind the walls."""

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import transform_points
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.free_space import shares_seen_through
from sgslam.surfels import SurfelMap

SMALL, LARGE = room(-2, -2, 2, 2), room(-4, -4, 4, 4)
HERE = pose(0.3, 0.2, 1.2)


def known(boxes: list[Box]) -> SurfelMap:
    """A room as a few scans show it."""
    surfels = SurfelMap()
    for k, (x, y) in enumerate([(0.0, 0.0), (0.5, 0.2), (-0.5, 0.4), (0.2, -0.6)]):
        T = pose(x, y, 1.2, yaw=0.3 * k, pitch=0.1 * k)
        points = scan(scene_of(boxes), T, seed=k)
        turned = points @ T[:3, :3].T
        surfels.add(turned + T[:3, 3], turned / np.linalg.norm(turned, axis=1, keepdims=True), 0.0, 100.0)
    return surfels


def through(boxes: list[Box], T: Array, surfels: SurfelMap) -> float:
    points = transform_points(T, scan(scene_of(boxes), T, seed=9))
    return shares_seen_through(points, T[:3, 3].copy(), surfels.arrays, -1.0)[1]


def test_no_ray_passes_the_walls_of_its_own_room() -> None:
    assert through(SMALL, HERE, known(SMALL)) < 0.01
    assert through(LARGE, HERE, known(LARGE)) < 0.01


def test_a_larger_room_is_seen_through_the_walls_of_a_smaller_one() -> None:
    assert through(LARGE, HERE, known(SMALL)) > 0.2
    assert through(SMALL, HERE, known(LARGE)) < 0.01


def test_the_far_side_of_a_wall_hides_nothing() -> None:
    """From outside, a room's inner faces are not what a ray meets."""
    surfels, T = known(SMALL), pose(3.0, 0.0, 1.2)
    beyond = np.array([[1.5, 0.0, 1.0], [1.4, 0.3, 1.2]]).repeat(8, axis=0)
    assert shares_seen_through(beyond, T[:3, 3].copy(), surfels.arrays, -1.0) == (0.0, 0.0)


def test_where_a_person_stood_is_no_wall_though_it_fills_the_view() -> None:
    person = (0.35, -0.1, 0.0, 0.85, 0.5, 1.7)
    surfels = known([*SMALL, person])
    near = np.linalg.norm(surfels.surfels()[0] - HERE[:3, 3], axis=1)
    assert near.min() < 0.4
    assert through(SMALL, HERE, surfels) < 0.5 * TrackingSettings().seen_through


@pytest.mark.parametrize(("past", "expected"), [(0.4, (0.0, 0.0)), (0.7, (1.0, 0.5))])
def test_a_point_just_behind_a_wall_may_be_of_that_wall(past: float, expected: tuple[float, float]) -> None:
    point = np.array([[2.0 + past, 0.0, 1.2]])
    assert shares_seen_through(point, np.array([0.0, 0.0, 1.2]), known(SMALL).arrays, -1.0) == expected


def opened(width: float) -> list[Box]:
    """The small room, with an opening of a width (m) in one wall to a space behind it."""
    wall = (-2.2, 2, 0, 2.2, 2.2, 2.6)
    pieces: list[Box] = [(-2.2, 2, 0, -width / 2, 2.2, 2.6), (width / 2, 2, 0, 2.2, 2.2, 2.6)]
    return [*(box for box in SMALL if box != wall), *pieces, *room(-2, 2.2, 2, 3.5)[1:]]


def last_health(there: list[Box], **settings: float) -> str:
    """The health of a scan in another room, after some in the small one: both share two walls and a corner."""
    odometry = ContinuousTimeOdometry(TrackingSettings(**settings))
    here = scene_of(SMALL)
    for k in range(8):
        odometry.register(k * 100_000_000, scan(here, pose(0.05 * k, 0.2, 1.2), seed=k))
    return odometry.register(800_000_000, scan(scene_of(there), pose(0.4, 0.2, 1.2), seed=8)).health


def test_a_room_whose_walls_stand_behind_the_known_ones_is_another_one() -> None:
    larger = room(-2, -2, 3.5, 3.5)
    assert last_health(larger) == "lost"
    assert last_health(larger, seen_through=1.0) != "lost"  # half of its points are where walls were known
    assert last_health(opened(1.2)) != "lost"  # a door
    assert last_health(opened(4.0)) == "lost"


@pytest.mark.parametrize(("scans", "is_lost"), [(3, False), (8, True)])
def test_a_sensor_that_sees_through_walls_is_followed_for_half_a_second(scans: int, is_lost: bool) -> None:
    """They may have been people who went away; if not, they stay seen through."""
    odometry = ContinuousTimeOdometry(TrackingSettings())
    small, larger = scene_of(SMALL), scene_of(room(-2, -2, 3.5, 3.5))
    lost, off = [], []
    for k in range(8 + scans + 1):
        T = pose(0.05 * k, 0.2, 1.2)
        found = odometry.register(k * 100_000_000, scan(larger if 8 <= k < 8 + scans else small, T, seed=k))
        lost.append(found.health == "lost")
        off.append(abs(found.T_odom_sensor[0, 3] - T[0, 3]))
    assert not any(lost[:8]) and all(lost[8 : 8 + scans])
    assert max(off[:11]) < 0.03
    assert lost[-1] is is_lost
    assert (off[-1] > 0.15) if is_lost else (off[-1] < 0.03)


def test_a_wall_near_by_through_which_most_rays_pass_is_seen_through_though_it_is_small() -> None:
    """Of a long corridor, whose surfaces are many."""
    corridor, panel = room(-20, -1, 20, 1), (0.9, -1.0, 0.0, 1.0, 1.0, 2.6)
    surfels, T = known([*corridor, panel]), pose(0.3, 0.0, 1.2)
    ahead = transform_points(T, scan(scene_of(corridor), T, seed=9))
    ahead = ahead[ahead[:, 0] > 1.6]
    of_rays, of_surfaces = shares_seen_through(ahead, T[:3, 3].copy(), surfels.arrays, -1.0)
    assert of_rays > 0.6 and of_surfaces < TrackingSettings().seen_through
