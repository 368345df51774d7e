"""The odometries, each as a run makes it, and how exact each one is in a furnished room."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from boxes import Array, pose
from walks import SCAN_NS

from data.trajectory import Trajectory
from sgslam.config import OdometrySettings, TrackingSettings
from sgslam.odometry import make_odometry
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.given import GivenPoses
from sgslam.registration import Registration


@dataclass(frozen=True)
class Limits:
    """Medians over three drives with other noise hold on any processor."""

    step: float = 0.01  # m, of one of 8 cm
    turn: float = 1.0  # degrees, of the whole way
    covered: float = 0.35  # m; standing still meanwhile would be 0.5. In 120 drives KISS-ICP was 0.24 off at most
    rolling: float = 0.06  # m, of 17 steps of 10 cm


LIMITS = {
    "continuous_time": Limits(),
    "small_gicp": Limits(),
    "kiss": Limits(step=0.02, turn=2.0, rolling=0.1),
    "given": Limits(),
}


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


def make(method: str, truth: list[Array]) -> Any:
    """A new one, with the settings of a run; `truth` is for what is told."""
    if method == "given":
        return Followed(truth)
    return make_odometry(OdometrySettings(method=method), TrackingSettings())  # type: ignore[arg-type]


def registered(method: str, scans: list[Array], truth: list[Array]) -> list[Registration]:
    odometry = make(method, truth)
    return [odometry.register(i * SCAN_NS, points) for i, points in enumerate(scans)]
