"""Estimates how far the clock of an IMU, or of another system's poses, is from that of the scans' stamps."""

import logging
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_STEP_S = 0.01  # s between the offsets that are compared; a hand's turns change over some 0.1 s
_OFFSETS_S = _STEP_S * np.arange(-30, 31)
_LONGEST_NS = round(1e9 * _OFFSETS_S[-1])
_LEAST_S = 0.01  # s; what a smaller offset does to a hand-held map is below 1 cm
_SIGMAS = 5.0  # standard deviations by which an offset must be larger; it is looked at after every scan
_RELATED = 0.25  # squared difference at the best offset, over the mean of all; unrelated motions differ alike at all


class Turning(Protocol):
    """Something that turns with the sensor, by its own clock."""

    @property
    def newest_ns(self) -> int | None:
        ...

    def turned(self, begin_ns: int, end_ns: int) -> tuple[NDArray[np.int64], Floats] | None:
        """Stamps (N,) from before a time to after another, and the turn until each: the sums (N, 3) of small rotation
        vectors. None where there is a gap."""


class ClockOffset(Stateful):
    """Compares how fast the sensor turns from scan to scan with how fast something else turns a little earlier or
    later. The offset has the least sum of squared differences; its standard deviation follows from the sum's curvature,
    which is small where the motion shows nothing. `advice` is a line once the offset is large for sure.
    """

    _STATE = ("advice", "_last", "_waiting", "_squares", "_count")

    def __init__(self) -> None:
        self.advice: str | None = None
        self._last: tuple[int, Floats] | None = None  # stamp and attitude of the newest scan
        self._waiting: list[tuple[int, int, float]] = []  # from one stamp to another, the sensor turned so fast (rad/s)
        self._squares = np.zeros(len(_OFFSETS_S))  # (rad/s)^2, for each offset
        self._count = 0

    def lose(self) -> None:
        """To be called where the next attitude does not follow from the last one."""
        self._last = None

    def add(self, stamp_ns: int, R_odom_sensor: Floats, other: Turning, name: str) -> None:
        """Adds the attitude (3, 3) of a scan; `other` is compared as far as it is known, and has that `name`."""
        if self._last is not None:
            before_ns, R_before = self._last
            turn = float(Rotation.from_matrix(R_before.T @ R_odom_sensor).magnitude())
            self._waiting.append((before_ns, stamp_ns, turn / (stamp_ns - before_ns) * 1e9))
        self._last = stamp_ns, R_odom_sensor.copy()
        newest_ns = other.newest_ns or 0
        while self._waiting and self._waiting[0][1] + _LONGEST_NS <= newest_ns:
            self._compare(*self._waiting.pop(0), other)
        if self.advice is None:
            self._judge(name)

    def _compare(self, begin_ns: int, end_ns: int, rate: float, other: Turning) -> None:
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
        """How much later the other clock is, and the standard deviation of that; None where the motion does not show
        it."""
        squares, best = self._squares, int(np.argmin(self._squares))
        if self._count < len(squares):  # one of so many offsets may fit so few scans by chance
            return None
        if not 0 < best < len(squares) - 1 or squares[best] > _RELATED * squares.mean():
            return None
        slope = (squares[best + 1] - squares[best - 1]) / (2 * _STEP_S)
        curvature = (squares[best + 1] - 2 * squares[best] + squares[best - 1]) / _STEP_S**2
        if curvature <= 0:
            return None
        variance = 2 * squares[best] / self._count / curvature
        return float(_OFFSETS_S[best] - slope / curvature), float(np.sqrt(variance))

    def _judge(self, name: str) -> None:
        found = self.offset_s()
        if found is None or abs(found[0]) < _LEAST_S + _SIGMAS * found[1]:
            return
        side = "ahead of" if found[0] > 0 else "behind"
        far = f"about {1e3 * abs(found[0]):.0f} ms {side}"
        self.advice = f"the clock of {name} is {far} the scans' stamps; check --stamp"
        _log.warning("%s", self.advice)
