"""The last steps of the sensor: their intervals, their mean, and how far a step may differ from a steady one."""

import numpy as np
from numpy.typing import NDArray

from sgslam.geometry.frames import inverse
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_MEAN_STEP_WEIGHT = 0.3  # of the newest step in the mean of the last ones
_STEP_ERROR = 0.05, 5.0  # m and m/s2 by which a step may differ from a steady one where no walls constrain it
_FASTEST_REGULAR = 2.5  # m/s; faster scans are picked out of a drive, or have wrong stamps


class StepHistory(Stateful):
    """`step` (4, 4) is the last T_last_sensor as tracked, None before the second scan; `stamp_ns` that of the newest
    scan, `interval_ns` the time since the one before it."""

    _STATE = ("step", "stamp_ns", "interval_ns", "_mean")

    def __init__(self) -> None:
        self.step: Floats | None = None
        self.stamp_ns, self.interval_ns = 0, 0
        self._mean = np.zeros(3)  # m, running mean of the last translations, sensor frame

    def is_regular(self, interval_ns: int) -> bool:
        """Whether an interval is about as long as the last one."""
        return 2 * self.interval_ns < 3 * interval_ns < 4.5 * self.interval_ns

    def advance(self, stamp_ns: int) -> None:
        """Moves on to the scan at a stamp; its step is added later."""
        self.interval_ns = stamp_ns - self.stamp_ns
        self.stamp_ns = stamp_ns

    def add(self, step: Floats) -> None:
        """Adds the step (4, 4) of the newest scan."""
        started, self.step = self.step is not None, step
        self._mean = self._mean + (_MEAN_STEP_WEIGHT if started else 1.0) * (step[:3, 3] - self._mean)

    @property
    def steady(self) -> Floats:
        """(4, 4) the last step with the mean translation of the last steps."""
        assert self.step is not None
        step = self.step.copy()
        step[:3, 3] = self._mean
        return step

    @property
    def max_error(self) -> float:
        """The largest plausible difference (m) of a step from a steady one."""
        seconds = self.interval_ns / 1e9
        if np.linalg.norm(self._mean) > _FASTEST_REGULAR * seconds:
            return np.inf
        return _STEP_ERROR[0] + _STEP_ERROR[1] * seconds**2


class OdometryFrame(Stateful):
    """Joins the frames of several odometry sources, where only some scans have poses of an external one.

    `external` is whether the last pose was external, None before the first.
    """

    _STATE = ("external", "_T_odom_source")

    def __init__(self) -> None:
        self.external: bool | None = None
        self._T_odom_source: Floats | None = None  # (4, 4) frame of the present source; None: odom itself

    def to_odom(self, T_source_sensor: Floats, external: bool, last_odom: Floats | None, step: Floats | None) -> Floats:
        """T_odom_sensor (4, 4) from the pose in the frame of its source.

        Where the source changes, its frame is placed so that the sensor continues from `last_odom` (4, 4), None for
        the first scan, by the last `step` (4, 4), None for standing still.
        """
        if external != self.external and last_odom is not None:
            step = np.eye(4) if step is None else step
            self._T_odom_source = last_odom @ step @ inverse(T_source_sensor)
        self.external = external
        return T_source_sensor if self._T_odom_source is None else self._T_odom_source @ T_source_sensor
