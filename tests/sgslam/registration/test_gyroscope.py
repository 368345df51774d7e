"""Turns of a gyroscope, its bias, and up by an accelerometer."""

import numpy as np
import pytest
from numpy.typing import NDArray
from odometry_contract import rolling
from scipy.spatial.transform import Rotation

from data.imu import ImuSamples
from data.simulation.imu import ImuModel, measured
from sgslam.config import ImuSettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.inertial import NO_TURNS, Gyroscope, ImuBuffer, MeasuredMotion, measured_up
from sgslam.odometry.continuous_time import ContinuousTimeOdometry

Array = NDArray[np.float64]
SECONDS = np.arange(0.0, 1.01, 0.1)


def walking(seconds: Array) -> Array:
    """Poses of a sensor on its side that sways on a walk in a circle."""
    T = np.tile(np.eye(4), (len(seconds), 1, 1))
    sway = 0.2 * np.sin(9.0 * seconds)
    T[:, :3, :3] = Rotation.from_euler("ZYX", np.column_stack([seconds, np.full(len(seconds), 1.5), sway])).as_matrix()
    T[:, :3, 3] = np.column_stack([np.cos(seconds), np.sin(seconds), 0.03 * np.sin(12.0 * seconds)])
    return T


def gyroscope(samples: ImuSamples) -> tuple[ImuBuffer, Gyroscope]:
    imu = ImuBuffer(ImuSettings())
    imu.add(samples)
    gyro = Gyroscope(imu)
    gyro.begin(0)
    return imu, gyro


def test_turns_between_knots_are_the_true_ones() -> None:
    _, gyro = gyroscope(measured(walking, 2.0, ImuModel(), 0))
    poses = walking(SECONDS)
    expected = poses[:-1, :3, :3].transpose(0, 2, 1) @ poses[1:, :3, :3]
    turns = gyro.between(SECONDS)
    assert turns.rotations == pytest.approx(expected, abs=1e-3)
    assert (turns.information > 0).all()


def test_samples_within_times_that_follow_one_another_are_each_given_once() -> None:
    samples = measured(walking, 1.0, ImuModel(), 0)
    imu, _ = gyroscope(samples)
    parts = [imu.within(begin, begin + 10**8) for begin in range(-1, 8 * 10**8, 10**8)]
    stamps = np.concatenate([part.stamps_ns for part in parts if part is not None])
    assert np.array_equal(stamps, samples.stamps_ns[samples.stamps_ns < 9 * 10**8])
    assert imu.within(9 * 10**8, 12 * 10**8) is None


def test_without_samples_nothing_is_told() -> None:
    gyro = Gyroscope(ImuBuffer(ImuSettings()))
    assert gyro.between(SECONDS) is NO_TURNS
    knots = walking(SECONDS)
    assert np.array_equal(gyro.turned(SECONDS, knots), knots)


def test_the_bias_is_found_by_the_attitudes_of_registration() -> None:
    samples = measured(walking, 10.0, ImuModel(), 0)
    bias = np.array([0.01, -0.02, 0.005])
    _, gyro = gyroscope(ImuSamples(samples.stamps_ns, samples.gyro + bias, samples.accel))
    for second in np.arange(0.0, 9.0, 0.1):
        gyro.follow(second, walking(np.array([second]))[0, :3, :3])
    assert gyro.bias == pytest.approx(bias, abs=1.5e-3)


def test_backwards_it_turns_back() -> None:
    _, gyro = gyroscope(measured(walking, 2.0, ImuModel(), 0))
    forth, back = gyro.between(SECONDS), gyro.backwards().between(-SECONDS[::-1])
    assert back.rotations[::-1] == pytest.approx(forth.rotations.transpose(0, 2, 1), abs=1e-9)


def test_up_is_known_after_a_second_of_walking_and_not_before() -> None:
    imu, _ = gyroscope(measured(walking, 2.0, ImuModel(), 0))
    poses, stamps = walking(SECONDS), np.rint(SECONDS * 1e9).astype(np.int64)
    in_first = inverse(poses[0]) @ poses
    up = measured_up(imu, stamps, in_first)
    assert up is not None
    assert np.degrees(np.arccos(up @ poses[0, 2, :3])) < 2.0
    assert measured_up(imu, stamps[:8], in_first[:8]) is None


@pytest.mark.parametrize(("unit", "told"), [(9.80665, True), (98.0, False), (0.1, False)])
def test_up_is_known_by_forces_in_g_and_not_in_another_unit(unit: float, told: bool) -> None:
    samples = measured(walking, 2.0, ImuModel(), 0)
    imu, _ = gyroscope(ImuSamples(samples.stamps_ns, samples.gyro, samples.accel / unit))
    poses, stamps = walking(SECONDS), np.rint(SECONDS * 1e9).astype(np.int64)
    up = measured_up(imu, stamps, inverse(poses[0]) @ poses)
    assert (up is not None) == told
    assert up is None or np.degrees(np.arccos(up @ poses[0, 2, :3])) < 2.0


def test_a_gap_of_samples_tells_nothing() -> None:
    samples = measured(walking, 2.0, ImuModel(), 0)
    kept = (samples.stamps_ns < 3 * 10**8) | (samples.stamps_ns > 5 * 10**8)
    _, gyro = gyroscope(ImuSamples(samples.stamps_ns[kept], samples.gyro[kept], samples.accel[kept]))
    known = gyro.between(SECONDS).information > 0
    assert known[0] and known[7]
    assert not known[3] and not known[4]


def test_an_imu_without_samples_changes_no_bit() -> None:
    silent = MeasuredMotion(ImuBuffer(ImuSettings()))
    settings = TrackingSettings()
    alone, beside = ContinuousTimeOdometry(settings), ContinuousTimeOdometry(settings, silent)
    scans, _, times = rolling()
    for k, (points, seconds) in enumerate(zip(scans[:8], times[:8], strict=True)):
        a, b = (own.register(k * 100_000_000, points, seconds) for own in (alone, beside))
        assert np.array_equal(a.T_odom_sensor, b.T_odom_sensor)
        assert np.array_equal(a.covariance, b.covariance)
