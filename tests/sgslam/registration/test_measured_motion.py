"""What an IMU tells of the motion between knots: unsteady turns, changes of the velocity, and the biases."""

from itertools import pairwise

import numpy as np
import pytest
from boxes import pose, room, scan, scene_of
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.geometry.raycast import TriangleScene
from data.imu import ImuSamples
from data.simulation.imu import ImuModel, measured
from sgslam.config import ImuSettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.inertial import ImuBuffer, MeasuredMotion
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.types import Motion

Array = NDArray[np.float64]
KNOTS = np.arange(0.5, 1.01, 0.05)
UP = np.array([0.0, 0.0, 1.0])


def shaken(seconds: Array) -> Array:
    """Poses of a sensor in a quick hand: it swings by 8 degrees, five times a second, and bounces by 1 cm."""
    T = np.tile(np.eye(4), (len(seconds), 1, 1))
    swing = 0.14 * np.sin(2 * np.pi * 5.0 * seconds)
    T[:, :3, :3] = Rotation.from_euler("ZYX", np.column_stack([swing + 0.3 * seconds, swing / 2, swing])).as_matrix()
    bounce = 0.01 * np.sin(2 * np.pi * 4.0 * seconds)
    T[:, :3, 3] = np.column_stack([0.8 * seconds, 0.2 * np.sin(seconds), 1.0 + bounce])
    return T


def motion_by(samples: ImuSamples, **settings: object) -> MeasuredMotion:
    imu = ImuBuffer(ImuSettings.model_validate(settings))
    imu.add(samples)
    motion = MeasuredMotion(imu)
    motion.begin(0)
    return motion


def true_changes(knots: Array) -> Array:
    """(K-2, 3) at the inner knots."""
    poses = shaken(knots)
    velocities = np.diff(poses[:, :3, 3], axis=0) / np.diff(knots)[:, None]
    return np.diff(velocities, axis=0)


def test_points_of_an_unsteady_turn_are_where_a_steady_one_shows_them() -> None:
    """Of points 5 m away: without, they are off by centimetres."""
    motion = motion_by(measured(shaken, 2.0, ImuModel(), 0))
    seconds = np.linspace(KNOTS[0], KNOTS[-1], 400)
    rays = 5 * np.random.default_rng(0).normal(size=(len(seconds), 3)) / np.sqrt(3)
    T = shaken(seconds)
    true = np.einsum("nij,nj->ni", T[:, :3, :3], rays)
    steady = Motion(KNOTS, shaken(KNOTS))
    unsteady = motion.unsteady(KNOTS)
    assert unsteady is not None

    def off(points: Array) -> Array:
        turned = Motion(steady.seconds, np.where(np.arange(4) < 3, steady.knots, np.eye(4)))
        turned.knots[:, :3, 3] = 0.0
        return np.asarray(np.linalg.norm(turned.placed(points, seconds) - true, axis=1))

    assert np.percentile(off(rays), 95) > 0.05
    assert np.percentile(off(unsteady.steadied(rays, seconds)), 95) < 0.01


def test_changes_of_the_velocity_are_the_true_ones_in_both_directions_of_time() -> None:
    motion = motion_by(measured(shaken, 2.0, ImuModel(), 0))
    expected = true_changes(KNOTS)
    assert np.abs(expected).max() > 0.2  # m/s from piece to piece
    found = motion.changes(KNOTS, shaken(KNOTS), 0.0, UP)
    assert found.information[0] == 0 and (found.information[1:] > 0).all()
    assert found.values[1:] == pytest.approx(expected, abs=0.005)
    with_first = motion.changes(KNOTS[1:], shaken(KNOTS[1:]), 0.05, UP)
    assert with_first.values == pytest.approx(found.values[1:], abs=1e-4)
    back = motion.backwards().changes(-KNOTS[::-1], shaken(KNOTS)[::-1].copy(), 0.0, UP)
    assert back.values[1:] == pytest.approx(expected[::-1], abs=0.005)


def test_forces_in_g_tell_the_same_also_while_the_sensor_nearly_falls() -> None:
    """For a tenth of a second the force is a third of gravity: 3.3 m/s2 are no 3.3 g."""
    samples = measured(shaken, 2.0, ImuModel(), 0)
    falls = (samples.stamps_ns >= 6 * 10**8) & (samples.stamps_ns < 7 * 10**8)
    accel = np.where(falls[:, None], samples.accel / 3, samples.accel)
    found = [
        motion_by(ImuSamples(samples.stamps_ns, samples.gyro, accel / unit)).changes(KNOTS, shaken(KNOTS), 0.0, UP)
        for unit in (1.0, 9.80665)
    ]
    assert found[0].values == pytest.approx(found[1].values, abs=1e-6)
    assert found[0].values[3, 2] < true_changes(KNOTS)[2, 2] - 0.2


def test_where_up_is_unknown_or_samples_are_missing_no_change_is_told() -> None:
    motion = motion_by(measured(shaken, 2.0, ImuModel(), 0))
    assert not motion.changes(KNOTS, shaken(KNOTS), 0.0, np.zeros(3)).information.any()
    late = KNOTS + 3.0
    assert not motion.changes(late, shaken(late), 0.05, UP).information.any()
    assert motion.unsteady(late) is None


def test_the_accelerometers_bias_is_found() -> None:
    samples = measured(shaken, 22.0, ImuModel(), 0)
    bias = np.array([0.15, -0.2, 0.1])
    motion = motion_by(ImuSamples(samples.stamps_ns, samples.gyro, samples.accel + bias))
    for begin in np.arange(0.5, 20.5, 0.1):
        knots = begin + np.array([0.0, 0.05, 0.1])
        motion.follow(knots, shaken(knots), motion.changes(knots, shaken(knots), 0.05, UP))
    assert motion._accel.bias == pytest.approx(bias, abs=0.03)


@pytest.mark.parametrize(("told", "most"), [(True, 0.05), (False, 10.0)])
def test_an_imu_beside_the_sensor_feels_what_the_sensor_would(told: bool, most: float) -> None:
    """Four centimetres beside a swinging sensor, that is metres a second squared."""
    beside = pose(0.03, 0.02, -0.04)
    samples = measured(lambda seconds: shaken(seconds) @ beside, 2.0, ImuModel(), 0)
    motion = motion_by(samples, translation=(0.03, 0.02, -0.04) if told else (0.0, 0.0, 0.0))
    off = motion.changes(KNOTS, shaken(KNOTS), 0.0, UP).values[1:] - true_changes(KNOTS)
    worst = float(np.abs(off).max())
    assert worst < most and (told or worst > 0.05)


def test_a_quick_hand_is_followed_many_times_better_with_an_imu() -> None:
    scene = scene_of([*room(0, 0, 7, 5), (2, 1, 0, 3, 2, 1.2), (5, 3, 0, 6, 4, 2.0)])
    start, columns, period = pose(2.0, 2.5, 0.0), 20, 0.1
    samples = measured(lambda seconds: start @ shaken(seconds), 3.5, ImuModel(), 0)
    errors = {}
    for name in ("alone", "imu"):
        imu = ImuBuffer(ImuSettings())
        imu.add(samples)
        odometry = ContinuousTimeOdometry(TrackingSettings(), MeasuredMotion(imu) if name == "imu" else None)
        found, true = list[Array](), list[Array]()
        for i in range(30):
            points, times = _swept(scene, start, i * period, period, columns)
            result = odometry.register(round(i * period * 1e9), points, times)
            if i == 2:
                first = start @ shaken(np.zeros(1))[0]
                odometry.level(first[2, :3])
            found.append(result.T_odom_sensor)
            true.append((start @ shaken(np.array([i * period])))[0])
        pairs = zip(pairwise(found[5:]), pairwise(true[5:]), strict=True)
        steps = [inverse(a) @ b @ inverse(inverse(c) @ d) for (a, b), (c, d) in pairs]
        errors[name] = float(np.median([np.linalg.norm(step[:3, 3]) for step in steps]))
    assert errors["alone"] > 0.01 and errors["imu"] < errors["alone"] / 5, errors


def _swept(scene: TriangleScene, start: Array, begin: float, period: float, columns: int) -> tuple[Array, Array]:
    """A scan whose points are measured one sector after another, and their times (N,) after its stamp."""
    parts = []
    for k in range(columns):
        T = (start @ shaken(np.array([begin + period * (k + 0.5) / columns])))[0]
        whole = scan(scene, T, seed=k)
        azimuth = np.arctan2(whole[:, 1], whole[:, 0]) % (2 * np.pi)
        parts.append(whole[(azimuth * columns / (2 * np.pi)).astype(int) == k])
    times = np.repeat((np.arange(columns) + 0.5) / columns * period, [len(part) for part in parts])
    return np.concatenate(parts), times
