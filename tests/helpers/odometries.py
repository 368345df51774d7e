"""The odometries, each as a run makes it, and how exact each one is in a furnished room."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from boxes import Array, pose
from walks import SCAN_NS, from_file

from data.trajectory import Trajectory
from sgslam.config import Config, OdometrySettings, TrackingSettings
from sgslam.odometry import Odometry, make_odometry
from sgslam.odometry.factory import ExternalOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.odometry.timed import TimedOdometry
from sgslam.types import Registration


@dataclass(frozen=True)
class Limits:
    """Medians over three drives with other noise hold on any processor."""

    step: float = 0.01  # m, of one of 8 cm
    turn: float = 1.0  # degrees, of the whole way
    covered: float = 0.35  # m; standing still meanwhile would be 0.5
    rolling: float = 0.06  # m, of 17 steps of 10 cm


LIMITS = {
    "continuous_time": Limits(),
    "small_gicp": Limits(),
    "kiss": Limits(step=0.02, turn=2.0, rolling=0.1),
    "given": Limits(),
}


class Told:
    """Poses of another system, of a third of the scans' rate and in another frame."""

    def __init__(self, truth: list[Array]) -> None:
        kept = [*range(0, len(truth) - 1, 3), len(truth) - 1]
        poses = pose(5.0, -3.0, 1.0, 2.0) @ np.stack(truth)[kept]
        self._given = ExternalOdometry(Trajectory(np.array(kept) * SCAN_NS, poses))

    def locate(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Array:
        return self._given.at(stamp_ns)


class Followed:
    """An odometry of others, whose poses are taken as a run takes them."""

    def __init__(self, odometry: Odometry) -> None:
        self._odometry, self._given = odometry, GivenMotion(OdometrySettings())

    def register(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Registration:
        self._given.add(stamp_ns, self._odometry.locate(stamp_ns, points, point_times))
        return self._given.newest(point_times)

    def restored(self) -> "Followed":
        """One that goes on with what a file holds; what is told holds nothing."""
        again = Followed(self._odometry if isinstance(self._odometry, Told) else from_file(self._odometry))
        again._given = from_file(self._given)
        return again


def make(method: str, truth: list[Array]) -> Any:
    """A new one, with the settings of a run; `truth` is for what is told."""
    if method == "continuous_time":
        return TimedOdometry(TrackingSettings())
    if method == "given":
        return Followed(Told(truth))
    odometry = make_odometry(Config(odometry=OdometrySettings(method=method)))  # type: ignore[arg-type]
    assert odometry is not None
    return Followed(odometry)


def registered(method: str, scans: list[Array], truth: list[Array]) -> list[Registration]:
    odometry = make(method, truth)
    return [odometry.register(i * SCAN_NS, points) for i, points in enumerate(scans)]
