"""Poses of another system as measurements: steps between knots, and what registration makes of them."""

from copy import deepcopy

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of

from sgslam.config import Config, OdometrySettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.registration import Registration
from sgslam.tracking.run_tracker import RunTracker
from sgslam.tracking.scan_tracker import TrackedScan

PERIOD_NS = 100_000_000
FURNISHED = [*room(0, 0, 7, 5), (5, 3.5, 0, 6, 4.5, 1.4), (1, 4, 0, 1.6, 5, 2.0)]
CORRIDOR = [(-70, -1.2, -0.1, 70, 1.2, 0.0), (-70, -1.4, 0, 70, -1.2, 2.6), (-70, 1.2, 0, 70, 1.4, 2.6)]


def motion_of(poses: list[Array], first_ns: int = 0) -> GivenMotion:
    given = GivenMotion(OdometrySettings())
    for k, T in enumerate(poses):
        given.add(first_ns + PERIOD_NS * k, T)
    return given


def jittering(poses: list[Array], metres: float, turn: float, seed: int = 0) -> list[Array]:
    """Poses in another frame, off by so many metres along each axis and by so much yaw (rad), each of them anew."""
    rng = np.random.default_rng(seed)
    elsewhere = pose(50.0, -20.0, 3.0, 1.0)
    return [elsewhere @ T @ pose(*rng.normal(0, metres, 3), rng.normal(0, turn)) for T in poses]


def registered(poses: list[Array], scans: list[Array], told: list[Array] | None) -> list[Registration]:
    """Poses are told scan by scan, as in a run."""
    given = None if told is None else GivenMotion(OdometrySettings())
    odometry, found = ContinuousTimeOdometry(TrackingSettings(), given=given), []
    for k, points in enumerate(scans):
        if given is not None and told is not None and k < len(told):
            given.add(PERIOD_NS * k, told[k])
        found.append(odometry.register(PERIOD_NS * k, points))
    return found


def off(found: list[Registration], poses: list[Array]) -> Array:
    """(N,) metres from the true motion since the first scan."""
    true = [inverse(poses[0]) @ T for T in poses]
    pairs = zip(found, true, strict=True)
    return np.array([np.linalg.norm(own.T_odom_sensor[:3, 3] - T[:3, 3]) for own, T in pairs])


def test_steps_are_the_motion_between_knots_whatever_the_frame() -> None:
    poses = [pose(0.1 * k, 0.0, 0.8, 0.1 * k) for k in range(5)]
    given = motion_of([pose(50.0, 3.0, 1.0, 2.0) @ T for T in poses], first_ns=7)
    steps = given.steps(7, np.array([0.0, 0.1, 0.15, 0.2]))
    assert steps.poses[0] == pytest.approx(inverse(poses[0]) @ poses[1])
    assert steps.poses[1] @ steps.poses[2] == pytest.approx(inverse(poses[1]) @ poses[2])
    settings = OdometrySettings()
    expected = 1 / np.array([settings.given_sigma_rotation, settings.given_sigma_translation]) ** 2
    assert steps.information[0] == pytest.approx(expected)
    assert steps.information[1] == pytest.approx(2 * expected)  # half a step, half its variance


def test_steps_backwards_are_the_inverse() -> None:
    poses = [pose(0.1 * k, 0.0, 0.8, 0.1 * k) for k in range(5)]
    steps = motion_of(poses).backwards().steps(0, np.array([-0.3, -0.2, -0.1]))
    assert steps.poses[0] == pytest.approx(inverse(poses[3]) @ poses[2])
    assert (steps.information > 0).all()


def test_what_no_pose_tells_is_not_measured() -> None:
    poses = [pose(0.1 * k, 0.0) for k in range(3)]
    given = motion_of(poses)
    assert list(given.steps(0, np.array([0.1, 0.2, 0.3])).information[:, 0] > 0) == [True, False]
    assert not GivenMotion(OdometrySettings()).steps(0, np.array([0.0, 0.1])).information.any()
    given.add(1_900_000_000, pose(2.0, 0.0))  # nobody knows how the sensor moved within 1.7 s
    assert not given.steps(0, np.array([0.3, 0.4])).information.any()


def test_a_covariance_that_is_told_replaces_the_setting() -> None:
    given = motion_of([pose(0.0, 0.0)])
    given.add(PERIOD_NS, pose(0.1, 0.0), np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4]))
    assert given.steps(0, np.array([0.0, 0.1])).information[0] == pytest.approx([1e6, 1e4])


def test_along_a_bare_corridor_the_given_steps_hold() -> None:
    """Who stops and goes where the walls do not show it is told so by the steps alone."""
    speed = np.repeat([1.2, 0.0, 1.2, 0.0], 15)
    poses = [pose(x, 0.0, 1.2) for x in np.concatenate([[0.0], np.cumsum(speed * 0.1)])]
    scene = scene_of(CORRIDOR)
    scans = [scan(scene, T, seed=k) for k, T in enumerate(poses)]
    told = off(registered(poses, scans, jittering(poses, 0.02, 0.01)), poses)
    untold = off(registered(poses, scans, None), poses)
    assert told.max() < 0.3 and untold.max() > 2 * told.max()


def test_steps_carry_a_covered_sensor_on() -> None:
    poses = [pose(1.5 + 0.05 * k, 2.0 + 0.01 * k, 0.8, 0.03 * k) for k in range(45)]
    scene, dark = scene_of(FURNISHED), slice(15, 35)
    scans = [scan(scene, T, seed=k) for k, T in enumerate(poses)]
    scans[dark] = [np.zeros((0, 3))] * 20
    found = registered(poses, scans, jittering(poses, 0.02, 0.01))
    untold = registered(poses, scans, None)
    assert {own.health for own in found[dark]} == {"lost"}  # nothing was seen
    assert off(found, poses)[dark].max() < 0.15 < off(untold, poses)[dark].max()
    assert {own.health for own in found[36:]} == {"good"} and off(found, poses)[36:].max() < 0.05


def test_poses_that_ended_carry_no_sensor_on() -> None:
    """The sensor walks, the poses end, it stands, and is covered after a second and a half."""
    poses = [pose(1.5 + 0.05 * min(k, 12), 2.0, 0.8) for k in range(45)]
    scans = [scan(scene_of(FURNISHED), T, seed=k) for k, T in enumerate(poses)]
    scans[28:] = [np.zeros((0, 3))] * 17
    found = registered(poses, scans, poses[:12])
    assert {own.health for own in found[28:]} == {"lost"} and off(found, poses).max() < 0.1


def test_steps_that_are_metres_wrong_do_no_harm() -> None:
    poses = [pose(1.5 + 0.05 * k, 2.0 + 0.01 * k, 0.8, 0.02 * k) for k in range(25)]
    scans = [scan(scene_of(FURNISHED), T, seed=k) for k, T in enumerate(poses)]
    found = registered(poses, scans, jittering(poses, 1.5, 0.5))
    assert {own.health for own in found} == {"good"}
    assert off(found, poses).max() < 0.02


def test_a_tracker_that_is_restored_goes_on_alike() -> None:
    poses = [pose(1.5 + 0.05 * k, 2.0 + 0.01 * k, 0.8, 0.02 * k) for k in range(50)]
    scans = [scan(scene_of(FURNISHED), T, seed=k) for k, T in enumerate(poses)]
    told = jittering(poses, 0.05, 0.02)
    config = Config(odometry=OdometrySettings(given="measured"))
    one, other = RunTracker(config), RunTracker(config)
    for k in range(40):
        one.track(PERIOD_NS * k, scans[k], None, told[k])
    other.restore(deepcopy(one.state()))
    for k in range(40, 50):
        found = [tracker.track(PERIOD_NS * k, scans[k], None, told[k]) for tracker in (one, other)]
        for a, b in zip(*found, strict=True):
            assert isinstance(a, TrackedScan) and isinstance(b, TrackedScan)
            assert a.raw.T_odom_sensor is None and a.health == "good"  # registered, not taken as it is
            assert np.array_equal(a.T_odom_sensor, b.T_odom_sensor)
