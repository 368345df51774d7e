"""The offset between the clocks of the scans and of what else measures how the sensor turns."""

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

SECONDS = np.arange(0.0, 20.0, 0.1)


def swaying(seconds: Array, faster: float = 1.0) -> Array:
    """Poses of a hand that walks on a wide circle."""
    T = np.tile(np.eye(4), (len(seconds), 1, 1))
    at = faster * seconds
    sways = np.column_stack([0.2 * at, 0.06 * np.sin(7.0 * at), 0.05 * np.sin(4.3 * at + np.sin(0.7 * at))])
    T[:, :3, :3] = Rotation.from_euler("ZYX", sways).as_matrix()
    return T


def standing(seconds: Array) -> Array:
    return np.tile(np.eye(4), (len(seconds), 1, 1))


def inertial(milliseconds: float, faster: float = 1.0) -> ImuBuffer:
    """An IMU whose stamps are so much later than those of the scans."""
    samples = measured(lambda seconds: swaying(seconds, faster), 20.0, ImuModel(), 0)
    imu = ImuBuffer(ImuSettings())
    imu.add(ImuSamples(samples.stamps_ns + round(1e6 * milliseconds), samples.gyro, samples.accel))
    return imu


def given(milliseconds: float) -> GivenMotion:
    other = GivenMotion(OdometrySettings())
    seconds = np.arange(0.0, 20.0, 0.05)
    for second, T in zip(seconds, swaying(seconds), strict=True):
        other.add(round(1e9 * second + 1e6 * milliseconds), T)
    return other


def compared(poses: Array, other: ImuBuffer | GivenMotion) -> ClockOffset:
    """With poses that registration finds, off by a twentieth of a degree about each axis."""
    clock, rng = ClockOffset(), np.random.default_rng(0)
    errors = Rotation.from_rotvec(rng.normal(0.0, 0.0009, (len(poses), 3))).as_matrix()
    for second, T, error in zip(SECONDS, poses, errors, strict=True):
        clock.add(round(1e9 * second), T[:3, :3] @ error, other, "the IMU")
        restored = ClockOffset()
        restored.restore(clock.state())
        clock = restored
    return clock


@pytest.mark.parametrize("milliseconds", [0.0, 5.0, -5.0, 15.0, -15.0, 50.0, -100.0])
@pytest.mark.parametrize("make", [inertial, given])
def test_offsets_of_more_than_ten_milliseconds_are_reported(make, milliseconds: float) -> None:  # type: ignore[no-untyped-def]
    clock = compared(swaying(SECONDS), make(milliseconds))
    found = clock.offset_s()
    assert found is not None and 1e3 * found[0] == pytest.approx(milliseconds, abs=2.5)
    assert (clock.advice is not None) == (abs(milliseconds) > 10)
    if clock.advice is not None:
        side = "ahead of" if milliseconds > 0 else "behind"
        assert clock.advice.startswith("the clock of the IMU is about ")
        assert clock.advice.endswith(f"ms {side} the scans' stamps; check --stamp")


def test_nothing_is_reported_of_a_sensor_that_stands_of_another_motion_and_across_gaps() -> None:
    clock = compared(standing(SECONDS), inertial(50.0))
    assert clock.offset_s() is None and clock.advice is None
    clock = compared(swaying(SECONDS), inertial(50.0, faster=1.37))
    assert clock.offset_s() is None and clock.advice is None
    clock = compared(swaying(SECONDS), inertial(5000.0 - 2.0e6))
    assert clock.offset_s() is None and clock.advice is None
