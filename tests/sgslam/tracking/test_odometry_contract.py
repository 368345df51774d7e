"""What every odometry keeps: scans of a furnished room go in, T_odom_sensor comes out."""

import functools
from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, pose, scan, scene_of
from odometries import LIMITS, REGISTERING, make, registered
from walks import SCAN_NS, SENSOR, bow, circle, from_file, furnished, off, rolling

from sgslam.geometry.frames import inverse, is_rigid, transform_points
from sgslam.registration import Registration

each = pytest.mark.parametrize("method", [*REGISTERING, "given"])
each_registering = pytest.mark.parametrize("method", REGISTERING)


@functools.cache
def drive(method: str, seed: int = 0) -> list[Registration]:
    return registered(method, *bow(seed))


def steps(poses: list[Array]) -> list[Array]:
    return [inverse(a) @ b for a, b in pairwise(poses)]


@each
def test_the_true_steps_are_recovered(method: str) -> None:
    medians, ends = [], []
    for seed in range(1 if method == "given" else 3):
        found, truth = [result.T_odom_sensor for result in drive(method, seed)], bow(seed)[1]
        errors = [off(a, b) for a, b in zip(steps(found), steps(truth), strict=True)]
        medians.append(np.median(errors, axis=0))
        ends.append(off(inverse(found[0]) @ found[-1], inverse(truth[0]) @ truth[-1]))
    limits = LIMITS[method]
    metres, radians = np.median(medians, axis=0)
    assert metres < limits.step and radians < np.radians(1.0)
    metres, radians = np.median(ends, axis=0)
    assert metres < 4 * limits.step and radians < np.radians(limits.turn)


@each
def test_one_that_is_restored_goes_on_alike_bit_by_bit(method: str) -> None:
    scans, truth = bow()
    whole = [result.T_odom_sensor.tobytes() for result in drive(method)]
    first, again = make(method, truth), make(method, truth)
    begun = [first.register(i * SCAN_NS, points) for i, points in enumerate(scans[:12])]
    again.restore(from_file(first.state()))
    begun += [again.register(i * SCAN_NS, points) for i, points in enumerate(scans[12:], 12)]
    assert [result.T_odom_sensor.tobytes() for result in begun] == whole


@each_registering
def test_a_covered_sensor_is_survived(method: str) -> None:
    """Three scans of three points, and three of one wall."""
    (scans, truth), wall = bow(), scene_of([(-20.0, 4.0, 0.0, 20.0, 4.2, 2.6)])
    poor = list(scans)
    poor[8:11] = [points[:3] for points in scans[8:11]]
    poor[14:17] = [scan(wall, truth[i], SENSOR, i) for i in range(14, 17)]
    found = [result.T_odom_sensor for result in registered(method, poor, truth)]
    assert all(is_rigid(T) for T in found)
    assert off(inverse(found[0]) @ found[-1], inverse(truth[0]) @ truth[-1])[0] < LIMITS[method].covered


@each_registering
def test_scans_of_next_to_nothing_are_survived(method: str) -> None:
    scans = [np.random.default_rng(i).uniform(-2, 2, (count, 3)) for i, count in enumerate([0, 1, 3, 10, 1, 0, 25])]
    assert all(is_rigid(result.T_odom_sensor) for result in registered(method, scans, bow()[1][:7]))


@each
def test_a_robot_that_stands_stays(method: str) -> None:
    place = pose(3.0, 2.5, 0.8, 0.4)
    found = registered(method, [scan(furnished(), place, SENSOR, i) for i in range(25)], [place] * 25)
    assert max(off(found[0].T_odom_sensor, result.T_odom_sensor)[0] for result in found) < LIMITS[method].stands


@each_registering
def test_a_scan_that_shows_something_else_is_not_good(method: str) -> None:
    scans, truth = bow()
    clutter = np.random.default_rng(0).uniform(-8.0, 8.0, (2000, 3))
    found = registered(method, [*scans[:10], clutter, *scans[10:13]], [*truth[:11], *truth[10:13]])
    healths = [result.health for result in found]
    assert "lost" not in healths[:10] and healths[-1] != "lost"
    assert healths[10] == "lost" if method == "continuous_time" else healths[10] != "good"


@each
def test_covariances_are_of_the_size_of_the_errors(method: str) -> None:
    for result in drive(method)[2:]:
        assert np.linalg.eigvalsh(result.covariance).min() > 0
        deviations = np.sqrt(np.diag(result.covariance))
        assert deviations[:3].min() > 1e-4 and deviations[:3].max() < 0.03
        assert deviations[3:].min() > 1e-4 and deviations[3:].max() < 0.1


@each
def test_scans_of_a_moving_sensor_are_undistorted(method: str) -> None:
    """The room is distorted by about as much as the sensor moves in a scan."""
    truth, limits = list(circle(0.1 * np.arange(24))), LIMITS[method]
    odometry = make(method, truth)
    found = [odometry.register(i * SCAN_NS, *timed) for i, timed in enumerate(rolling())]
    # the first scans build up the map and the velocity
    since = inverse(found[6].T_odom_sensor) @ found[-1].T_odom_sensor
    metres, radians = off(since, inverse(truth[6]) @ truth[-1])
    assert metres < limits.rolling and radians < np.radians(2.5)
    assert max(off(result.motion.at(0.0), result.T_odom_sensor)[0] for result in found) < 1e-6
    (points, times), T = rolling()[-1], truth[-1]
    late = times > 0.09
    raw, right = points[late], found[-1].undistorted(points)[late]
    true = transform_points(inverse(T) @ circle(np.array([2.395]))[0], raw)
    assert np.median(np.linalg.norm(right - true, axis=1)) < 0.5 * np.median(np.linalg.norm(raw - true, axis=1))
    step = off(found[-1].T_odom_sensor, found[-1].motion.at(0.1))[0]
    assert step == pytest.approx(off(truth[-2], truth[-1])[0], abs=limits.last_step)
