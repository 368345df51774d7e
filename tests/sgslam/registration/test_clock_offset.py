"""The offset between the clocks of the scans and of what else measures how the sensor turns."""

from collections.abc import Callable

import numpy as np
import pytest
from boxes import Array
from scipy.spatial.transform import Rotation

from data.imu import ImuSamples
from data.simulation.imu import ImuModel, measured
from sgslam.config import ImuSettings, OdometrySettings
from sgslam.inertial import ImuBuffer
from sgslam.odometry.given_motion import GivenMotion
from sgslam.tracking.clock_offset import ClockOffset

Other = ImuBuffer | GivenMotion


def swaying(seconds: Array, faster: float = 1.0) -> Array:
    """Poses of a hand that walks on a wide circle."""
    T, at = np.tile(np.eye(4), (len(seconds), 1, 1)), faster * seconds
    sways = np.column_stack([0.2 * at, 0.06 * np.sin(7.0 * at), 0.05 * np.sin(4.3 * at + np.sin(0.7 * at))])
    T[:, :3, :3] = Rotation.from_euler("ZYX", sways).as_matrix()
    return T


def inertial(milliseconds: float, faster: float = 1.0) -> Other:
    """An IMU whose stamps are so much later than those of the scans."""
    samples = measured(lambda seconds: swaying(seconds, faster), 20.0, ImuModel(), 0)
    imu = ImuBuffer(ImuSettings())
    imu.add(ImuSamples(samples.stamps_ns + round(1e6 * milliseconds), samples.gyro, samples.accel))
    return imu


def given(milliseconds: float) -> Other:
    other, seconds = GivenMotion(OdometrySettings()), np.arange(0.0, 20.0, 0.05)
    for second, T in zip(seconds, swaying(seconds), strict=True):
        other.add(round(1e9 * second + 1e6 * milliseconds), T)
    return other


def compared(other: Other, moves: bool = True) -> ClockOffset:
    """With poses that registration finds, off by a twentieth of a degree about each axis; restored after each."""
    clock, rng = ClockOffset(), np.random.default_rng(0)
    for second in np.arange(0.0, 20.0, 0.1):
        R = swaying(np.array([second]))[0, :3, :3] if moves else np.eye(3)
        error = Rotation.from_rotvec(rng.normal(0.0, 0.0009, 3)).as_matrix()
        clock.add(round(1e9 * second), R @ error, other, "the IMU")
        state, clock = clock.state(), ClockOffset()
        clock.restore(state)
    return clock


@pytest.mark.parametrize("milliseconds", [0.0, 5.0, -5.0, 15.0, -15.0, 50.0, -100.0])
@pytest.mark.parametrize("make", [inertial, given])
def test_offsets_of_more_than_ten_milliseconds_are_reported(
    make: Callable[[float], Other], milliseconds: float
) -> None:
    clock = compared(make(milliseconds))
    found = clock.offset_s()
    assert found is not None and 1e3 * found[0] == pytest.approx(milliseconds, abs=2.5)
    assert (clock.advice is not None) == (abs(milliseconds) > 10)
    assert clock.advice is None or ("ahead" if milliseconds > 0 else "behind") in clock.advice


@pytest.mark.parametrize(
    ("other", "moves"),
    [(inertial(50.0), False), (inertial(50.0, faster=1.37), True), (inertial(5000.0 - 2.0e6), True)],
    ids=["a sensor that stands", "another motion", "gaps"],
)
def test_nothing_is_reported_of(other: Other, moves: bool) -> None:
    clock = compared(other, moves)
    assert clock.offset_s() is None and clock.advice is None
