"""External odometry: a trajectory (TUM file), interpolated at the stamps of the scans."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds
from sgslam.config.sensor import SENSOR
from sgslam.odometry.base import GAP_NS

Floats = NDArray[np.float64]
_BEYOND_NS = round(SENSOR.scan_seconds * NS)  # extrapolation before the first pose and after the last


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
