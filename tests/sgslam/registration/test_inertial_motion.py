"""What an IMU tells: turns between knots, changes of the velocity, up, its biases, and the offset of its clock."""

from collections.abc import Callable

import numpy as np
import pytest
from boxes import Array, pose
from scipy.spatial.transform import Rotation
from walks import SCAN_NS, from_file, furnished, step_errors, swept

from data.imu import ImuSamples
from data.simulation.sensor import ImuModel, measured
from sgslam.config import ImuSettings, OdometrySettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.inertial import NO_STEPS, ImuBuffer, MeasuredMotion, measured_up
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.tracking.clock_offset import ClockOffset

SECONDS = np.arange(0.0, 1.01, 0.1)
KNOTS = np.arange(0.5, 1.01, 0.05)
UP = np.array([0.0, 0.0, 1.0])
G = 9.80665
Other = ImuBuffer | GivenMotion


def poses_of(angles: list[Array], places: list[Array]) -> Array:
    """(N, 4, 4) of angles about z, y and x (N,) and x, y, z (N,)."""
    T = np.tile(np.eye(4), (len(angles[0]), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("ZYX", np.column_stack(angles)).as_matrix()
    T[:, :3, 3] = np.column_stack(places)
    return T


def walking(seconds: Array) -> Array:
    """A sensor on its side that sways on a walk in a circle."""
    circle = [np.cos(seconds), np.sin(seconds), 0.03 * np.sin(12.0 * seconds)]
    return poses_of([seconds, np.full(len(seconds), 1.5), 0.2 * np.sin(9.0 * seconds)], circle)


def shaken(seconds: Array) -> Array:
    """A sensor in a quick hand: it swings by 8 degrees, five times a second, and bounces by 1 cm."""
    swing, bounce = 0.14 * np.sin(2 * np.pi * 5.0 * seconds), 0.01 * np.sin(2 * np.pi * 4.0 * seconds)
    return poses_of([swing + 0.3 * seconds, swing / 2, swing], [0.8 * seconds, 0.2 * np.sin(seconds), 1.0 + bounce])


def felt(moved: Callable[[Array], Array], seconds: float = 2.0, bias: tuple[Array, Array] | None = None) -> ImuSamples:
    """With biases of the rates and the forces."""
    samples = measured(moved, seconds, ImuModel(), 0)
    gyro, accel = bias or (np.zeros(3), np.zeros(3))
    return ImuSamples(samples.stamps_ns, samples.gyro + gyro, samples.accel + accel)


def buffer(samples: ImuSamples, **settings: object) -> ImuBuffer:
    imu = ImuBuffer(ImuSettings.model_validate(settings))
    imu.add(samples)
    return imu


def motion_by(samples: ImuSamples, **settings: object) -> MeasuredMotion:
    motion = MeasuredMotion(buffer(samples, **settings))
    motion.begin(0)
    return motion


def true_changes(knots: Array) -> Array:
    """(K-2, 3) of the velocity, at the inner knots."""
    return np.diff(np.diff(shaken(knots)[:, :3, 3], axis=0) / np.diff(knots)[:, None], axis=0)


def test_samples_are_kept_for_the_scans_that_need_them() -> None:
    imu, second_ns = buffer(felt(walking, 60.0)), 10**9  # all before the first scan
    for second in range(55):
        assert imu.around((second - 2) * second_ns, second * second_ns) is not None or second < 2
        imu.forget(second * second_ns)
    assert imu.around(second_ns, 2 * second_ns) is None
    newest = imu.newest_ns
    imu.forget(1000 * second_ns)
    assert imu.newest_ns == newest is not None


def test_turns_between_knots_are_the_true_ones() -> None:
    turns, poses = motion_by(felt(walking)).turns(SECONDS), walking(SECONDS)
    expected = poses[:-1, :3, :3].transpose(0, 2, 1) @ poses[1:, :3, :3]
    assert turns.poses[:, :3, :3] == pytest.approx(expected, abs=1e-3)
    assert (turns.information[:, 0] > 0).all() and not turns.information[:, 1].any()


def test_where_samples_are_missing_or_up_is_unknown_nothing_is_told() -> None:
    silent, knots = MeasuredMotion(ImuBuffer(ImuSettings())), walking(SECONDS)
    assert silent.turns(SECONDS) is NO_STEPS and np.array_equal(silent.turned(SECONDS, knots), knots)
    samples = felt(walking)
    kept = (samples.stamps_ns < 3 * 10**8) | (samples.stamps_ns > 5 * 10**8)
    gap = ImuSamples(samples.stamps_ns[kept], samples.gyro[kept], samples.accel[kept])
    known = motion_by(gap).turns(SECONDS).information[:, 0] > 0
    assert list(known[[0, 3, 4, 7]]) == [True, False, False, True]
    motion, late = motion_by(felt(shaken)), KNOTS + 3.0
    assert not motion.changes(KNOTS, shaken(KNOTS), 0.0, np.zeros(3)).information.any()
    assert not motion.changes(late, shaken(late), 0.05, UP).information.any()
    assert motion.unsteady(late) is None


def test_the_biases_are_found_by_registration() -> None:
    of_rates, of_forces = np.array([0.01, -0.02, 0.005]), np.array([0.15, -0.2, 0.1])
    motion, unbiased = motion_by(felt(shaken, 22.0, (of_rates, of_forces))), motion_by(felt(shaken, 22.0))
    for begin in np.arange(0.5, 20.5, 0.1):
        knots = begin + np.array([0.0, 0.05, 0.1])
        changes = motion.changes(knots, shaken(knots), 0.05, UP)
        true = unbiased.changes(knots, shaken(knots), 0.05, UP)
        off = np.abs(changes.values - true.values).max()  # m/s in 0.05 s
        assert begin > 0.5 or off > 0.005
        motion.follow(knots, shaken(knots), changes)
    assert off < 0.0015 and motion.biases[0] == pytest.approx(of_rates, abs=1.5e-3)


@pytest.mark.parametrize(
    ("unit", "scans", "told"), [(1.0, 11, True), (1.0, 8, False), (G, 11, True), (98.0, 11, False), (0.1, 11, False)]
)
def test_up_is_known_after_a_second_of_walking_in_either_unit_of_force(unit: float, scans: int, told: bool) -> None:
    samples, poses = felt(walking), walking(SECONDS)
    imu = buffer(ImuSamples(samples.stamps_ns, samples.gyro, samples.accel / unit))
    up = measured_up(imu, np.rint(SECONDS[:scans] * 1e9).astype(np.int64), inverse(poses[0]) @ poses[:scans], 1.6)
    assert (up is not None) == told
    assert up is None or np.degrees(np.arccos(up @ poses[0, 2, :3])) < 2.0


def test_changes_of_the_velocity_are_the_true_ones() -> None:
    motion, expected = motion_by(felt(shaken)), true_changes(KNOTS)
    assert np.abs(expected).max() > 0.2  # m/s from piece to piece
    found = motion.changes(KNOTS, shaken(KNOTS), 0.0, UP)
    assert found.information[0] == 0 and (found.information[1:] > 0).all()
    assert found.values[1:] == pytest.approx(expected, abs=0.005)
    with_first = motion.changes(KNOTS[1:], shaken(KNOTS[1:]), 0.05, UP)
    assert with_first.values == pytest.approx(found.values[1:], abs=1e-4)


def test_an_imu_beside_the_sensor_feels_what_the_sensor_would() -> None:
    """Four centimetres beside a swinging sensor, that is metres a second squared."""
    beside = (0.03, 0.02, -0.04)
    samples, worst = felt(lambda seconds: shaken(seconds) @ pose(*beside)), []
    for told in (beside, (0.0, 0.0, 0.0)):
        changes = motion_by(samples, translation=told).changes(KNOTS, shaken(KNOTS), 0.0, UP)
        worst.append(np.abs(changes.values[1:] - true_changes(KNOTS)).max())
    assert worst[0] < 0.05 < worst[1]


@pytest.mark.slow
def test_a_quick_hand_is_followed_many_times_better_with_an_imu() -> None:
    start = pose(2.0, 2.5, 0.0)
    scans = [swept(furnished(), lambda seconds: start @ shaken(seconds), 0.1 * i) for i in range(20)]
    true, errors = start @ shaken(0.1 * np.arange(20)), []
    for motion in (None, MeasuredMotion(buffer(felt(lambda seconds: start @ shaken(seconds), 3.5)))):
        odometry, found = ContinuousTimeOdometry(TrackingSettings(), motion), []
        for i, timed in enumerate(scans):
            found.append(odometry.register(i * SCAN_NS, *timed))
            if i == 2:
                odometry.level(true[0, 2, :3])
        errors.append(np.median(step_errors(found[5:], true[5:])[:, 0]))
    assert errors[0] > 0.01 and errors[1] < errors[0] / 5, errors


def hand(seconds: Array, faster: float = 1.0) -> Array:
    """One that sways, on a walk on a wide circle."""
    at = faster * seconds
    sways = [0.2 * at, 0.06 * np.sin(7.0 * at), 0.05 * np.sin(4.3 * at + np.sin(0.7 * at))]
    return poses_of(sways, [0 * at, 0 * at, 0 * at])


def inertial(milliseconds: float, faster: float = 1.0) -> ImuBuffer:
    """An IMU whose stamps are so much later than those of the scans."""
    samples = felt(lambda seconds: hand(seconds, faster), 20.0)
    return buffer(ImuSamples(samples.stamps_ns + round(1e6 * milliseconds), samples.gyro, samples.accel))


def given(milliseconds: float) -> GivenMotion:
    other, seconds = GivenMotion(OdometrySettings()), np.arange(0.0, 20.0, 0.05)
    for second, T in zip(seconds, hand(seconds), strict=True):
        other.add(round(1e9 * second + 1e6 * milliseconds), T)
    return other


def compared(other: Other, moves: bool = True) -> ClockOffset:
    """With poses that registration finds, off by a twentieth of a degree about each axis; restored after each."""
    clock, rng = ClockOffset(), np.random.default_rng(0)
    for second in np.arange(0.0, 20.0, 0.1):
        R = hand(np.array([second]))[0, :3, :3] if moves else np.eye(3)
        error = Rotation.from_rotvec(rng.normal(0.0, 0.0009, 3)).as_matrix()
        clock.add(round(1e9 * second), R @ error, other, "the IMU")
        clock = from_file(clock)
    return clock


@pytest.mark.parametrize("milliseconds", [0.0, 5.0, -5.0, 15.0, -15.0, 50.0, -100.0])
@pytest.mark.parametrize("make", [inertial, given])
def test_an_offset_of_the_clocks_is_reported(make: Callable[[float], Other], milliseconds: float) -> None:
    clock = compared(make(milliseconds))
    found = clock.offset_s()
    assert found is not None and 1e3 * found[0] == pytest.approx(milliseconds, abs=2.5)
    assert (clock.advice is not None) == (abs(milliseconds) > 10)
    assert clock.advice is None or ("ahead" if milliseconds > 0 else "behind") in clock.advice


def test_no_offset_is_reported_of_a_sensor_that_stands_of_another_motion_and_across_gaps() -> None:
    for clock in (compared(inertial(50), False), compared(inertial(50, 1.37)), compared(inertial(5000 - 2e6))):
        assert clock.offset_s() is None and clock.advice is None
