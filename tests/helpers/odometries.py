"""The odometries, each as a run makes it, and how exact each one is in a furnished room."""

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from boxes import Array, pose
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from walks import SCAN_NS

from data.imu import ImuSamples
from data.simulation.imu import ImuModel, measured
from data.trajectory import Trajectory
from sgslam.config import ImuSettings, OdometrySettings, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.inertial import ImuBuffer
from sgslam.odometry import METHODS, make_odometry
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.factory import INERTIAL
from sgslam.odometry.given import GivenPoses
from sgslam.registration import Registration


@dataclass(frozen=True)
class Limits:
    """Medians over three drives with other noise hold on any processor."""

    step: float = 0.01  # m, of one of 8 cm
    turn: float = 1.0  # degrees, of the whole way
    covered: float = 0.35  # m; standing still meanwhile would be 0.5. In 120 drives KISS-ICP was 0.24 off at most
    rolling: float = 0.06  # m, of 17 steps of 10 cm
    last_step: float = 0.03  # m, of one of these
    stands: float = 0.05  # m


LIMITS = {
    "continuous_time": Limits(),
    "small_gicp": Limits(),
    "kiss": Limits(step=0.02, turn=2.0, rolling=0.1),
    # cells of 0.7 m for points: measured 0.025 m a step, and 0.31 to 0.43 m where it slipped along a wall
    "rko_lio": Limits(step=0.04, turn=2.0, covered=0.7, rolling=0.1, last_step=0.08),
    # its planes need a second of scans: until then it turns by a degree; standing it moved by 0.01 to 0.11 m
    "genz_lio": Limits(step=0.02, turn=2.5, rolling=0.1, stands=0.2),
    "given": Limits(),
}
REGISTERING = [
    pytest.param(m, marks=pytest.mark.skipif(m in INERTIAL and find_spec(m) is None, reason=f"needs the extra {m}"))
    for m in METHODS
]


class Followed:
    """Poses of another system, of a third of the scans' rate and in another frame, instead of registration."""

    def __init__(self, truth: list[Array]) -> None:
        kept = [*range(0, len(truth) - 1, 3), len(truth) - 1]
        poses = pose(5.0, -3.0, 1.0, 2.0) @ np.stack(truth)[kept]
        self._given = ExternalOdometry(Trajectory(np.array(kept) * SCAN_NS, poses))
        self._poses = GivenPoses(OdometrySettings())
        self.state, self.restore = self._poses.state, self._poses.restore

    def register(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Registration:
        return self._poses.register(stamp_ns, self._given.at(stamp_ns), point_times)


def felt(truth: list[Array], interval_ns: int) -> ImuSamples:
    """What an IMU without errors measures on the way through the poses, and as it goes on at their ends."""
    begins, ends = inverse(truth[1]) @ truth[0], inverse(truth[-2]) @ truth[-1]
    poses = np.stack([truth[0] @ begins, *truth, truth[-1] @ ends, truth[-1] @ ends @ ends])
    at = (np.arange(len(poses)) - 1) * interval_ns / 1e9
    places, turns = CubicSpline(at, poses[:, :3, 3]), RotationSpline(at, Rotation.from_matrix(poses[:, :3, :3]))

    def moved(seconds: Array) -> Array:
        T = np.tile(np.eye(4), (len(seconds), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = turns(seconds).as_matrix(), places(seconds)
        return T

    return measured(moved, at[-1] - 0.01, ImuModel(), 0)


def make(method: str, truth: list[Array]) -> Any:
    """A new one, with the settings of a run; `truth` is for those that feel it or are told."""
    if method == "given":
        return Followed(truth)
    imu = ImuBuffer(ImuSettings())
    if method in INERTIAL:
        imu.add(felt(truth, SCAN_NS))
    settings = OdometrySettings(method=method)  # type: ignore[arg-type]
    return make_odometry(settings, TrackingSettings(), imu if method in INERTIAL else None)


def registered(method: str, scans: list[Array], truth: list[Array]) -> list[Registration]:
    odometry = make(method, truth)
    return [odometry.register(i * SCAN_NS, points) for i, points in enumerate(scans)]
