"""Estimates how far the clock of an IMU, or of another system's poses, is from that of the scans' stamps."""

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.inertial import ImuBuffer
from sgslam.odometry.given_motion import GivenMotion

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_STEP_S = 0.01  # s between the offsets that are compared; what a smaller one does to a hand-held map is below 1 cm
_OFFSETS_S = _STEP_S * np.arange(-30, 31)
_LONGEST_NS = round(1e9 * _OFFSETS_S[-1])
_SIGMAS = 5.0  # standard deviations by which an offset must be larger; it is looked at after every scan
_RELATED = 0.25  # squared difference at the best offset, over the mean of all; unrelated motions differ alike at all


class ClockOffset:
    """Compares how fast the sensor turns from scan to scan with how fast something else turns earlier or later.

    The offset has the least sum of squared differences; its standard deviation follows from the sum's curvature, which
    is small where the motion shows nothing. `advice` is a line once the offset is large for sure.
    """

    def __init__(self) -> None:
        self.advice: str | None = None
        self._last: tuple[int, Floats] | None = None  # stamp and attitude of the newest scan
        self._waiting: list[tuple[int, int, float]] = []  # from one stamp to another, the sensor turned so fast (rad/s)
        self._squares, self._count = np.zeros(len(_OFFSETS_S)), 0  # (rad/s)^2, for each offset, of so many scans

    def lose(self) -> None:
        """To be called where the next attitude does not follow from the last one."""
        self._last = None

    def add(self, stamp_ns: int, R_odom_sensor: Floats, other: ImuBuffer | GivenMotion, name: str) -> None:
        """Adds the attitude (3, 3) of a scan; `other`, which has that `name`, is known until its stamp."""
        if self._last is not None:
            before_ns, R_before = self._last
            turn = float(Rotation.from_matrix(R_before.T @ R_odom_sensor).magnitude())
            self._waiting.append((before_ns, stamp_ns, turn / (stamp_ns - before_ns) * 1e9))
        self._last = stamp_ns, R_odom_sensor.copy()
        while self._waiting and self._waiting[0][1] + _LONGEST_NS <= stamp_ns:  # `other` is known so far
            self._compare(*self._waiting.pop(0), other)
        found = None if self.advice else self.offset_s()
        if found is not None and abs(found[0]) > _STEP_S + _SIGMAS * found[1]:
            far = f"about {1e3 * abs(found[0]):.0f} ms {'ahead of' if found[0] > 0 else 'behind'}"
            self.advice = f"the clock of {name} is {far} the scans' stamps; check --stamp"
            _log.warning("%s", self.advice)

    def _compare(self, begin_ns: int, end_ns: int, rate: float, other: ImuBuffer | GivenMotion) -> None:
        found = other.turned(begin_ns - _LONGEST_NS, end_ns + _LONGEST_NS)
        if found is None:
            return
        seconds, lasted = (found[0] - begin_ns) / 1e9, (end_ns - begin_ns) / 1e9
        begins, ends = (
            np.stack([np.interp(at, seconds, sums) for sums in found[1].T]) for at in (_OFFSETS_S, _OFFSETS_S + lasted)
        )
        self._squares += (np.linalg.norm(ends - begins, axis=0) / lasted - rate) ** 2
        self._count += 1

    def offset_s(self) -> tuple[float, float] | None:
        """How much later the other clock is, and the standard deviation; None where the motion does not show it."""
        squares, best = self._squares, int(np.argmin(self._squares))
        # one of so many offsets may fit fewer scans by chance
        if self._count < len(squares) or not 0 < best < len(squares) - 1:
            return None
        curvature = (squares[best + 1] - 2 * squares[best] + squares[best - 1]) / _STEP_S**2
        if squares[best] > _RELATED * squares.mean() or curvature <= 0:
            return None
        slope = (squares[best + 1] - squares[best - 1]) / (2 * _STEP_S)
        sigma = np.sqrt(2 * squares[best] / self._count / curvature)
        return float(_OFFSETS_S[best] - slope / curvature), float(sigma)
