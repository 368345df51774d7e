"""Poses of another system as measurements: steps between knots, and what registration makes of them."""

import numpy as np
import pytest
from boxes import Array, pose, scan, scene_of
from walks import CORRIDOR, SCAN_NS, furnished, straight, ways_off

from sgslam.config import OdometrySettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.types import Registration

NOTHING = np.zeros((0, 3))


def seen(poses: list[Array]) -> list[Array]:
    return [scan(furnished(), T, seed=k) for k, T in enumerate(poses)]


def jittering(poses: list[Array], metres: float, turn: float) -> list[Array]:
    """Poses in another frame, off by so many metres along each axis and by so much yaw (rad), each of them anew."""
    rng, elsewhere = np.random.default_rng(0), pose(50.0, -20.0, 3.0, 1.0)
    return [elsewhere @ T @ pose(*rng.normal(0, metres, 3), rng.normal(0, turn)) for T in poses]


def registered(scans: list[Array], told: list[Array]) -> list[Registration]:
    """Poses are told scan by scan, as in a run."""
    given, found = GivenMotion(OdometrySettings()), []
    odometry = ContinuousTimeOdometry(TrackingSettings(), given=given)
    for k, points in enumerate(scans):
        if k < len(told):
            given.add(SCAN_NS * k, told[k])
        found.append(odometry.register(SCAN_NS * k, points))
    return found


def healths(found: list[Registration]) -> set[str]:
    return {result.health for result in found}


def test_steps_are_the_motion_between_knots_whatever_the_frame() -> None:
    poses, settings = [pose(0.1 * k, 0.0, 0.8, 0.1 * k) for k in range(5)], OdometrySettings()
    given = GivenMotion(settings)
    for k, T in enumerate(poses):
        given.add(7 + SCAN_NS * k, pose(50.0, 3.0, 1.0, 2.0) @ T)
    steps = given.steps(7, np.array([0.0, 0.1, 0.15, 0.2]))
    assert steps.poses[0] == pytest.approx(inverse(poses[0]) @ poses[1])
    assert steps.poses[1] @ steps.poses[2] == pytest.approx(inverse(poses[1]) @ poses[2])
    expected = 1 / np.array([settings.given_sigma_rotation, settings.given_sigma_translation]) ** 2
    assert steps.information[0] == pytest.approx(expected)
    assert steps.information[1] == pytest.approx(2 * expected)  # half a step, half its variance


def test_what_no_pose_tells_is_not_measured_and_a_told_covariance_replaces_the_setting() -> None:
    given = GivenMotion(OdometrySettings())
    assert not given.steps(0, np.array([0.0, 0.1])).information.any()
    for k, covariance in enumerate([None, np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4]), None]):
        given.add(SCAN_NS * k, pose(0.1 * k, 0.0), covariance)
    assert given.steps(0, np.array([0.0, 0.1])).information[0] == pytest.approx([1e6, 1e4])
    assert list(given.steps(0, np.array([0.1, 0.2, 0.3])).information[:, 0] > 0) == [True, False]
    given.add(19 * SCAN_NS, pose(2.0, 0.0))  # nobody knows how the sensor moved within 1.7 s
    assert not given.steps(0, np.array([0.3, 0.4])).information.any()


def test_along_a_bare_corridor_the_given_steps_hold() -> None:
    """Who stops and goes where the walls do not show it is told so by the steps alone."""
    speed = np.repeat([1.2, 0.0, 1.2, 0.0], 15)
    poses = [pose(x, 0.0, 1.2) for x in np.concatenate([[0.0], np.cumsum(speed * 0.1)])]
    scans = [scan(scene_of(CORRIDOR), T, seed=k) for k, T in enumerate(poses)]
    told, untold = (ways_off(registered(scans, by), poses).max() for by in (jittering(poses, 0.02, 0.01), []))
    assert told < 0.3 and untold > 2 * told


def test_steps_carry_a_covered_sensor_on() -> None:
    poses, dark = straight(45, turn=0.03), slice(15, 35)
    scans = seen(poses)
    scans[dark] = [NOTHING] * 20
    found, untold = registered(scans, jittering(poses, 0.02, 0.01)), registered(scans, [])
    off = ways_off(found, poses)
    assert healths(found[dark]) == {"lost"}  # nothing was seen
    assert off[dark].max() < 0.15 < ways_off(untold, poses)[dark].max()
    assert healths(found[36:]) == {"good"} and off[36:].max() < 0.05


def test_poses_that_ended_carry_no_sensor_on() -> None:
    """The sensor walks, the poses end, it stands, and is covered after a second and a half."""
    poses = [pose(1.5 + 0.05 * min(k, 12), 2.0, 0.8) for k in range(45)]
    found = registered([*seen(poses[:28]), *[NOTHING] * 17], poses[:12])
    assert healths(found[28:]) == {"lost"} and ways_off(found, poses).max() < 0.1


def test_steps_that_are_metres_wrong_do_no_harm() -> None:
    poses = straight(25)
    found = registered(seen(poses), jittering(poses, 1.5, 0.5))
    assert healths(found) == {"good"} and ways_off(found, poses).max() < 0.02
