"""A scan at a wrong pose sees through known walls; at its own it does not, whatever lies behind the walls."""

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of
from walks import SCAN_NS

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import transform_points
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.free_space import shares_seen_through
from sgslam.surfels import SurfelMap
from sgslam.tracking.level_frame import add_seen

SMALL, LARGE = room(-2, -2, 2, 2), room(-4, -4, 4, 4)
LARGER = room(-2, -2, 3.5, 3.5)  # shares two walls and a corner with the small one
HERE = pose(0.3, 0.2, 1.2)


def known(boxes: list[Box]) -> SurfelMap:
    """A room as a few scans show it."""
    surfels = SurfelMap()
    for k, (x, y) in enumerate([(0.0, 0.0), (0.5, 0.2), (-0.5, 0.4), (0.2, -0.6)]):
        T = pose(x, y, 1.2, yaw=0.3 * k, pitch=0.1 * k)
        add_seen(surfels, scan(scene_of(boxes), T, seed=k), T)
    return surfels


def through(boxes: list[Box], T: Array, surfels: SurfelMap) -> float:
    points = transform_points(T, scan(scene_of(boxes), T, seed=9))
    return shares_seen_through(points, T[:3, 3].copy(), surfels.arrays, -1.0)[1]


def test_a_larger_room_is_seen_through_the_walls_of_a_smaller_one() -> None:
    for there, surfels in ((SMALL, SMALL), (LARGE, LARGE), (SMALL, LARGE)):
        assert through(there, HERE, known(surfels)) < 0.01
    assert through(LARGE, HERE, known(SMALL)) > 0.2


@pytest.mark.parametrize(
    ("sensor", "points", "expected"),
    [
        # from outside, a room's inner faces are not what a ray meets
        (pose(3.0, 0.0, 1.2), [[1.5, 0.0, 1.0], [1.4, 0.3, 1.2]], (0.0, 0.0)),
        # a point just behind a wall may be of that wall
        (pose(0.0, 0.0, 1.2), [[2.4, 0.0, 1.2]], (0.0, 0.0)),
        (pose(0.0, 0.0, 1.2), [[2.7, 0.0, 1.2]], (1.0, 0.5)),
    ],
)
def test_the_far_side_of_a_wall_and_what_is_just_behind_it_hide_nothing(
    sensor: Array, points: list[list[float]], expected: tuple[float, float]
) -> None:
    of_rays = np.repeat(points, 8, axis=0)
    assert shares_seen_through(of_rays, sensor[:3, 3].copy(), known(SMALL).arrays, -1.0) == expected


def test_where_a_person_stood_is_no_wall_though_it_fills_the_view() -> None:
    surfels = known([*SMALL, (0.35, -0.1, 0.0, 0.85, 0.5, 1.7)])
    assert np.linalg.norm(surfels.surfels()[0] - HERE[:3, 3], axis=1).min() < 0.4
    assert through(SMALL, HERE, surfels) < 0.5 * TrackingSettings().seen_through


def test_a_wall_near_by_through_which_most_rays_pass_is_seen_through_though_it_is_small() -> None:
    """Of a long corridor, whose surfaces are many."""
    corridor, panel = room(-20, -1, 20, 1), (0.9, -1.0, 0.0, 1.0, 1.0, 2.6)
    surfels, T = known([*corridor, panel]), pose(0.3, 0.0, 1.2)
    ahead = transform_points(T, scan(scene_of(corridor), T, seed=9))
    ahead = ahead[ahead[:, 0] > 1.6]
    of_rays, of_surfaces = shares_seen_through(ahead, T[:3, 3].copy(), surfels.arrays, -1.0)
    assert of_rays > 0.6 and of_surfaces < TrackingSettings().seen_through


def opened(width: float) -> list[Box]:
    """The small room, with an opening of a width (m) in one wall to a space behind it."""
    wall = (-2.2, 2, 0, 2.2, 2.2, 2.6)
    pieces: list[Box] = [(-2.2, 2, 0, -width / 2, 2.2, 2.6), (width / 2, 2, 0, 2.2, 2.2, 2.6)]
    return [*(box for box in SMALL if box != wall), *pieces, *room(-2, 2.2, 2, 3.5)[1:]]


def followed(there: list[Box], scans: int, again: int, **settings: float) -> tuple[list[bool], list[float]]:
    """Which scans are lost, and how far off along x: eight in the small room, some in another, some in the first."""
    odometry, lost, off = ContinuousTimeOdometry(TrackingSettings(**settings)), [], []
    small, other = scene_of(SMALL), scene_of(there)
    for k in range(8 + scans + again):
        T = pose(0.05 * k, 0.2, 1.2)
        found = odometry.register(k * SCAN_NS, scan(other if 8 <= k < 8 + scans else small, T, seed=k))
        lost.append(found.health == "lost")
        off.append(abs(found.T_odom_sensor[0, 3] - T[0, 3]))
    return lost, off


@pytest.mark.parametrize(
    ("there", "settings", "is_lost"),
    [
        (LARGER, {}, True),
        (LARGER, {"seen_through": 1.0}, False),  # half of its points are where walls were known
        (opened(1.2), {}, False),  # a door
        (opened(4.0), {}, True),
    ],
)
def test_a_room_whose_walls_stand_behind_the_known_ones_is_another_one(
    there: list[Box], settings: dict[str, float], is_lost: bool
) -> None:
    assert followed(there, 1, 0, **settings)[0] == [*[False] * 8, is_lost]


@pytest.mark.parametrize(("scans", "is_lost"), [(3, False), (8, True)])
def test_a_sensor_that_sees_through_walls_is_followed_for_half_a_second(scans: int, is_lost: bool) -> None:
    """They may have been people who went away; if not, they stay seen through."""
    lost, off = followed(LARGER, scans, 1)
    assert lost == [*[False] * 8, *[True] * scans, is_lost]
    assert max(off[:11]) < 0.03
    assert off[-1] > 0.15 if is_lost else off[-1] < 0.03
