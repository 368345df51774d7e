"""External odometry: a trajectory (TUM file), interpolated at the stamps of the scans."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds
from sgslam.odometry.base import GAP_NS

Floats = NDArray[np.float64]
_BEYOND_NS = NS // 10  # extrapolation before the first pose and after the last, for the time of one scan


class ExternalOdometry:
    """T_odom_sensor at any stamp that the trajectory covers; `name` is used in messages."""

    def __init__(self, trajectory: Trajectory, name: str = "the odometry") -> None:
        """Raises UserError for fewer than two poses."""
        if len(trajectory) < 2:
            raise UserError(f"{name}: one pose is not an odometry; give a trajectory over all scans")
        self._trajectory, self._name = trajectory, name
        self._steps = np.diff(trajectory.stamps_ns)

    @staticmethod
    def read(path: Path | str) -> "ExternalOdometry":
        """Reads a TUM file; raises UserError where it is invalid."""
        return ExternalOdometry(Trajectory.read_tum(path), str(path))

    def check(self, stamps_ns: Sequence[int] | NDArray[np.int64]) -> None:
        """Raises UserError, naming the first stamp, if the trajectory does not cover all of `stamps_ns` (N,)."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        bad = np.flatnonzero(~self._covered(stamps))
        if bad.size:
            raise UserError(self._uncovered(int(stamps[bad[0]]), int(bad.size), len(stamps)))

    def at(self, stamp_ns: int) -> Floats:
        """T_odom_sensor (4, 4) at a stamp; raises UserError where the trajectory does not cover it."""
        if not self._covered(np.array([stamp_ns]))[0]:
            raise UserError(self._uncovered(int(stamp_ns), 1, 1))
        return np.array(self._trajectory.at(np.array([stamp_ns]))[0])

    def _after(self, stamps: NDArray[np.int64]) -> NDArray[np.intp]:
        """(M,) the index of the pose after each stamp, clipped to poses with a predecessor."""
        return np.clip(np.searchsorted(self._trajectory.stamps_ns, stamps), 1, len(self._trajectory) - 1)

    def _covered(self, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        own = self._trajectory.stamps_ns
        within = (stamps >= own[0] - _BEYOND_NS) & (stamps <= own[-1] + _BEYOND_NS)
        at_a_pose = np.isin(stamps, own)
        return within & (at_a_pose | (self._steps[self._after(stamps) - 1] <= GAP_NS))

    def _uncovered(self, stamp: int, count: int, of: int) -> str:
        own = self._trajectory.stamps_ns
        span = f"{ns_to_seconds(int(own[0]))} to {ns_to_seconds(int(own[-1]))} s"
        which = f"the scan at {ns_to_seconds(stamp)} s" + (f" and {count - 1} more of {of}" if count > 1 else "")
        what = "is in a gap of it" if own[0] <= stamp <= own[-1] else "lies outside"
        return f"{self._name}: covers {span}, {which} {what}; give poses by the scans' clock, at least one per second"
