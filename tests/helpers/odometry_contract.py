"""What every odometry must do; test modules inherit it, one class for each implementation."""

import functools
import json
from abc import ABC, abstractmethod
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of
from scipy.spatial.transform import Rotation

from data.simulation import SpinningSensor
from sgslam.geometry.frames import inverse, is_rigid
from sgslam.odometry import Odometry
from sgslam.registration import Registration
from sgslam.registration.beliefs import Belief
from sgslam.registration.sampling import TimedPoints
from sgslam.serialization.state_tree import Packer, Unpacker

SENSOR = SpinningSensor(azimuths=360)
FURNISHED: list[Box] = [
    *room(-3.0, -2.0, 5.0, 3.0), (1.5, 1.2, 0.0, 2.1, 3.0, 2.6), (-3.0, -2.0, 0.0, -1.8, -1.4, 1.8),
    (3.9, -0.5, 0.0, 5.0, 0.0, 2.6),
]  # fmt: skip
ONE_WALL: list[Box] = [(-20.0, 2.0, 0.0, 20.0, 2.2, 2.6)]
SCAN_NS = 100_000_000
_DRIVES = 3
_SETTLED = 6  # scans


def way(count: int = 24) -> list[Array]:
    """T_scene_sensor along a bow, from rest, 8 cm and 2 degrees a scan."""
    poses, x, y, yaw = [], -1.5, -0.8, 0.3
    for i in range(count):
        poses.append(pose(x, y, 0.8, yaw))
        step = 0.08 * min(1.0, i / 5)
        x, y, yaw = x + step * np.cos(yaw), y + step * np.sin(yaw), yaw + 0.4 * step
    return poses


@functools.cache
def bow() -> tuple[list[Array], list[Array]]:
    """Scans (N, 3) of a furnished room, and where they were taken."""
    return bows()[0]


@functools.cache
def bows() -> list[tuple[list[Array], list[Array]]]:
    """The same way again and again, each time with other noise: what one run measures, the last bit may turn over."""
    scene, poses = scene_of(FURNISHED), way()
    return [([scan(scene, T, SENSOR, 100 * k + seed) for seed, T in enumerate(poses)], poses) for k in range(_DRIVES)]


def steps(poses: list[Array]) -> list[Array]:
    return [inverse(a) @ b for a, b in pairwise(poses)]


def off(T_a: Array, T_b: Array) -> tuple[float, float]:
    """Metres and radians between two motions."""
    between = inverse(T_a) @ T_b
    return float(np.linalg.norm(between[:3, 3])), float(Rotation.from_matrix(between[:3, :3]).magnitude())


@functools.cache
def rolling() -> tuple[list[Array], list[Array], list[Array]]:
    """Scans of a sensor that moves in a circle, where it was at their beginnings, and their points' times (N,)."""
    scene, columns = scene_of(FURNISHED), 36
    scans, truth, times = [], [], []
    for i in range(24):
        parts = []
        for k in range(columns):
            at = i + k / columns
            T = pose(0.955 * np.sin(np.radians(6 * at)), -0.955 * np.cos(np.radians(6 * at)), 0.8, np.radians(6 * at))
            whole = scan(scene, T, SENSOR, 100 * i + k)
            azimuth = np.arctan2(whole[:, 1], whole[:, 0]) % (2 * np.pi)
            parts.append(whole[(azimuth * columns / (2 * np.pi)).astype(int) == k])
            if k == 0:
                truth.append(T)
        scans.append(np.concatenate(parts))
        times.append(np.repeat(np.arange(columns) / columns * SCAN_NS / 1e9, [len(part) for part in parts]))
    return scans, truth, times


def from_file(state: dict[str, Any]) -> Any:
    """A state as a file would give it back."""
    known = {"TimedPoints": TimedPoints, "Belief": Belief}
    packer = Packer(known)
    tree = json.loads(json.dumps(packer.pack(state)))
    return Unpacker(known, packer.arrays()).unpack(tree)


class OdometryContract(ABC):
    """For any odometry: scans go in, T_odom_sensor comes out.

    Its bounds are for the median of the drives, on any processor."""

    step_error, end_turn = 0.01, 1.0  # m, of a step of 8 cm; degrees, of the whole way
    stands, rolling_end = 0.05, 0.06  # m, farthest of a standing robot; of 17 steps of 10 cm
    covered = 0.35  # m; standing still meanwhile would be 0.5

    @abstractmethod
    def tracked(self, scans: list[Array], truth: list[Array]) -> list[Array]:
        """T_odom_sensor of each scan by a new odometry; `truth` is for those that are told where they go."""

    def test_it_recovers_the_true_steps(self) -> None:
        medians, ends = [], []
        for scans, truth in bows():
            found = self.tracked(scans, truth)
            errors = np.array([off(a, b) for a, b in zip(steps(found), steps(truth), strict=True)])
            medians.append(np.median(errors, axis=0))
            ends.append(off(inverse(found[0]) @ found[-1], inverse(truth[0]) @ truth[-1]))
        metres, radians = np.median(medians, axis=0)
        assert metres < self.step_error and radians < np.radians(1.0)
        metres, radians = np.median(ends, axis=0)
        assert metres < 4 * self.step_error and radians < np.radians(self.end_turn)

    def test_the_same_scans_give_the_same_bits(self) -> None:
        scans, truth = bow()
        first, second = (np.stack(self.tracked(scans[:10], truth[:10])) for _ in range(2))
        assert first.tobytes() == second.tobytes()

    def test_a_covered_sensor_is_survived(self) -> None:
        """Three scans of three points, and three of one wall."""
        wall = scene_of(ONE_WALL)
        for scans, truth in bows():
            poor = [s[:3] if 8 <= i < 11 else scan(wall, truth[i], SENSOR, i) if 14 <= i < 17 else s
                    for i, s in enumerate(scans)]  # fmt: skip
            found = self.tracked(poor, truth)
            assert all(is_rigid(T) for T in found)
            # in 120 drives by KISS-ICP at most 0.24, by small_gicp 0.01
            assert off(inverse(found[0]) @ found[-1], inverse(truth[0]) @ truth[-1])[0] < self.covered

    def test_scans_of_next_to_nothing_are_survived(self) -> None:
        scans = [np.random.default_rng(i).uniform(-2, 2, (count, 3)) for i, count in enumerate([0, 1, 3, 10, 1, 0, 25])]
        found = self.tracked(scans, way(len(scans)))
        assert len(found) == len(scans) and all(is_rigid(T) for T in found)


class RegistrationContract(OdometryContract):
    """For an odometry that registers scans."""

    last_step = 0.03  # m, of one of 10 cm

    @abstractmethod
    def make(self, truth: list[Array]) -> Odometry:
        """A new one, with the settings of a run; `truth` is where the scans are taken, which an IMU feels."""

    def registered(self, scans: list[Array], truth: list[Array]) -> list[Registration]:
        odometry = self.make(truth)
        return [odometry.register(i * SCAN_NS, points) for i, points in enumerate(scans)]

    def tracked(self, scans: list[Array], truth: list[Array]) -> list[Array]:
        return [result.T_odom_sensor for result in self.registered(scans, truth)]

    def test_one_that_is_restored_goes_on_alike(self) -> None:
        scans, truth = bow()
        whole, again = self.make(truth), self.make(truth)
        for i, points in enumerate(scans[:12]):
            whole.register(i * SCAN_NS, points)
        again.restore(from_file(whole.state()))
        for i, points in enumerate(scans[12:], 12):
            both = [o.register(i * SCAN_NS, points).T_odom_sensor.tobytes() for o in (whole, again)]
            assert both[0] == both[1]

    def test_a_robot_that_stands_stays(self) -> None:
        scene, place = scene_of(FURNISHED), pose(0.0, 0.5, 0.8, 0.4)
        found = self.tracked([scan(scene, place, SENSOR, i) for i in range(25)], [place] * 25)
        assert max(off(found[0], T)[0] for T in found) < self.stands

    def test_a_scan_that_shows_something_else_is_not_good(self) -> None:
        scans, truth = bow()
        clutter = np.random.default_rng(0).uniform(-8.0, 8.0, (2000, 3))
        found = self.registered([*scans[:10], clutter, *scans[10:13]], [*truth[:11], *truth[10:13]])
        healths = [result.health for result in found]
        assert healths[10] != "good" and "lost" not in healths[:10] and healths[-1] != "lost"

    def test_covariances_are_of_the_size_of_the_errors(self) -> None:
        for result in self.registered(*bow())[2:]:
            assert np.linalg.eigvalsh(result.covariance).min() > 0
            deviations = np.sqrt(np.diag(result.covariance))
            assert deviations[:3].max() < 0.03 and deviations[3:].max() < 0.1

    def test_scans_of_a_moving_sensor_are_undistorted(self) -> None:
        """In each scan the sensor moves by 10 cm and turns by 6 degrees, which distorts the room by about as much."""
        scans, truth, times = rolling()
        odometry = self.make(truth)
        found = [odometry.register(i * SCAN_NS, s, t) for i, (s, t) in enumerate(zip(scans, times, strict=True))]
        # the first scans build up the map and the velocity
        since = inverse(found[_SETTLED].T_odom_sensor) @ found[-1].T_odom_sensor
        metres, radians = off(since, inverse(truth[_SETTLED]) @ truth[-1])
        assert metres < self.rolling_end and radians < np.radians(2.5)
        moved = [off(a.motion.at(0.0), a.T_odom_sensor)[0] for a in found]
        assert max(moved) < 1e-6
        step = off(found[-1].T_odom_sensor, found[-1].motion.at(SCAN_NS / 1e9))[0]
        assert step == pytest.approx(off(truth[-2], truth[-1])[0], abs=self.last_step)
