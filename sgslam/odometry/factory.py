"""The odometry that the settings or `--odometry` name: another method, or a trajectory (TUM file)."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds
from sgslam.config import Config, OdometrySettings
from sgslam.config.sensor import SENSOR
from sgslam.odometry.base import GAP_NS, Odometry

Floats = NDArray[np.float64]
_BEYOND_NS = round(SENSOR.scan_seconds * NS)  # extrapolation before the first pose and after the last
METHODS: tuple[str, ...] = get_args(OdometrySettings.model_fields["method"].annotation)


class ExternalOdometry:
    """T_odom_sensor at any stamp that the trajectory covers; `name` is used in messages."""

    def __init__(self, trajectory: Trajectory, name: str = "the odometry") -> None:
        """Raises UserError for fewer than two poses."""
        if len(trajectory) < 2:
            raise UserError(f"{name}: one pose is not an odometry; give a trajectory over all scans")
        self._trajectory, self._name = trajectory, name

    @staticmethod
    def read(path: Path | str) -> "ExternalOdometry":
        """Reads a TUM file; raises UserError where it is invalid."""
        return ExternalOdometry(Trajectory.read_tum(path), str(path))

    def check(self, stamps_ns: Sequence[int] | NDArray[np.int64]) -> None:
        """Raises UserError, naming the first stamp, if the trajectory does not cover all of `stamps_ns` (N,)."""
        stamps, own = np.asarray(stamps_ns, dtype=np.int64), self._trajectory.stamps_ns
        within = (stamps >= own[0] - _BEYOND_NS) & (stamps <= own[-1] + _BEYOND_NS)
        after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
        bad = stamps[~within | ((np.diff(own)[after - 1] > GAP_NS) & ~np.isin(stamps, own))]
        if bad.size:
            span = f"{ns_to_seconds(int(own[0]))} to {ns_to_seconds(int(own[-1]))} s"
            more = f" and {len(bad) - 1} more of {len(stamps)}" if len(bad) > 1 else ""
            what = "is in a gap of it" if own[0] <= bad[0] <= own[-1] else "lies outside"
            raise UserError(
                f"{self._name}: covers {span}, the scan at {ns_to_seconds(int(bad[0]))} s{more} {what}; give poses by "
                "the scans' clock, at least one per second"
            )

    def at(self, stamp_ns: int) -> Floats:
        """T_odom_sensor (4, 4) at a stamp; raises UserError where the trajectory does not cover it."""
        self.check([stamp_ns])
        return np.array(self._trajectory.at(np.array([stamp_ns]))[0])


def make_odometry(config: Config) -> Odometry | None:
    """The odometry of others that is named in the settings; None for our own."""
    if config.odometry.method == "kiss":
        from sgslam.odometry.kiss import KissOdometry

        return KissOdometry(config.odometry, config.tracking)
    if config.odometry.method == "small_gicp":
        from sgslam.odometry.small_gicp import SmallGicpOdometry

        return SmallGicpOdometry(config.tracking)
    return None


def choose(value: str, config: Config) -> tuple[Config, ExternalOdometry | None]:
    """The settings with the method `value`, or the odometry of the TUM file `value`.

    Raises UserError if it is neither, or the file cannot be read.
    """
    if value in METHODS:
        return config.model_copy(update={"odometry": config.odometry.model_copy(update={"method": value})}), None
    path = Path(value)
    if path.exists():
        return config, ExternalOdometry.read(path)
    near = difflib.get_close_matches(value, METHODS, 1, 0.5)
    hint = f"did you mean {near[0]}?" if near else f"give {', '.join(METHODS)}, or a TUM file"
    raise UserError(f"--odometry {value}: no such file, and no such method; {hint}")
