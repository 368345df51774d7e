"""Stamps of scans, and the times of their points."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory.stamps import NS, ns_to_seconds

LOOK_AHEAD = 8  # next scans that decide whether a stamp far ahead is right
GAP_NS = 10 * NS  # longer pauses between scans are reported
_FEWEST = 4  # scans: of fewer, a single odd stamp would decide
_FASTEST, _SLOWEST = 1e-3, 1e4  # s between any scans: none are faster, nor hours apart
_EVEN = 0.2  # of the median, within which the middle half of a LiDAR's intervals lies; stations are set up less evenly
Floats = NDArray[np.float64]
Stamped = Literal["auto", "start", "middle", "end"]  # the instant of a scan that its stamp names; auto: unknown
BEFORE_STAMP: dict[Stamped, float] = {"auto": 0.0, "start": 0.0, "middle": 0.5, "end": 1.0}  # share of a scan
# Ouster: t; Velodyne: time; Hesai, RoboSense, Livox: timestamp; Livox: offset_time; others' spellings of these
TIME_FIELDS = (
    "t", "time", "timestamp", "offsettime", "timestamps", "timeoffset", "gpstime", "pointtimeoffset", "pointtime",
    "stamp", "stamps", "ts", "lidartime", "reltime", "relativetime",
)  # fmt: skip
_UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # seconds, ms, us, ns
_TURN = 0.1  # s: what most LiDARs need for a scan
_LONGEST = 2.0  # s: no scan takes longer
_SINCE_1973 = 1e8  # s: a larger time is one of a clock
_ROUNDED = 1e-3  # by which a fraction may be above 1
_HALF = 1 << 31  # of what 32 bits hold
_QUICKEST = 0.02  # s between the scans of a LiDAR
_MUCH = 2.0  # times the interval between scans that no scan lasts


class StampRule:
    """Judges stamps (ns) one after the other.

    A single wrong stamp costs only its own scan: one far ahead is rejected if most of the next scans come before it.
    """

    def __init__(self) -> None:
        self.last_ns: int | None = None
        self.gaps: list[tuple[int, int, int]] = []  # (index, stamp before, stamp after)

    def judge(self, index: int, stamp_ns: int, following: Callable[[], Sequence[int]]) -> str | None:
        """Returns why this scan cannot be used, or None. `following` yields the stamps of the next scans, at most
        LOOK_AHEAD.
        """
        last = self.last_ns
        if last is not None and stamp_ns <= last:
            how = "repeats" if stamp_ns == last else f"goes back by {ns_to_seconds(last - stamp_ns)} s from"
            return f"its stamp {how} that of the previous scan ({ns_to_seconds(last)} s)"
        if last is None or stamp_ns - last > GAP_NS:
            ahead = list(following())
            between = sum((last is None or last < s) and s <= stamp_ns for s in ahead)
            if between and 2 * between > len(ahead):
                return f"its stamp ({ns_to_seconds(stamp_ns)} s) is ahead of those that follow"
            if last is not None:
                self.gaps.append((index, last, stamp_ns))
        self.last_ns = stamp_ns
        return None

    def remark(self) -> str | None:
        """A line on long pauses, None if there was none."""
        if not self.gaps:
            return None
        index, before, after = max(self.gaps, key=lambda gap: gap[2] - gap[1])
        more = f"; there are {len(self.gaps) - 1} more such pauses" if len(self.gaps) > 1 else ""
        return (
            f"no scans for {ns_to_seconds(after - before).rstrip('0').rstrip('.')} s before scan {index}: if the "
            f"sensor moved meanwhile, the map has a break there{more}"
        )


def unusable(stamps_ns: Sequence[int]) -> dict[int, str]:
    """The scans whose stamps cannot be used, by their index, with the reason."""
    rule = StampRule()

    def judge(index: int, stamp_ns: int) -> str | None:
        return rule.judge(index, stamp_ns, lambda: stamps_ns[index + 1 : index + 1 + LOOK_AHEAD])

    return {index: why for index, stamp_ns in enumerate(stamps_ns) if (why := judge(index, stamp_ns))}


def check_interval(stamps_ns: Sequence[int], where: str) -> None:
    """Raises UserError if the stamps of scans seem to be in another unit. `where` says what holds them.

    Scans that are minutes apart are accepted if they are so unevenly: they may be a survey's.
    """
    if len(stamps_ns) < _FEWEST:
        return
    low, interval, high = np.percentile(np.diff(np.array(stamps_ns, dtype=np.float64)) / NS, [25, 50, 75]).tolist()
    of_milliseconds = _QUICKEST <= interval * 1e-3 <= _LONGEST and high - low <= _EVEN * interval
    # stamps that do not increase are judged elsewhere
    if 0 < interval < _FASTEST or interval > _SLOWEST or of_milliseconds:
        raise UserError(
            f"{where}: the scans are {interval:.3g} s apart by their stamps, which seem to be in another unit; give "
            "seconds in times.txt, in names seconds with a decimal point or nanoseconds"
        )


def time_field(names: Sequence[str]) -> str | None:
    """The name of the time field among a point's fields, whatever its case and underscores; None if there is none."""
    # CloudCompare puts `scalar_` before the name of a field each time that it saves it
    by_name = {name.lower().replace("scalar_", "").replace("_", ""): name for name in reversed(names)}
    if "s" in by_name:  # s and t are a texture's coordinates
        by_name.pop("t", None)
    return next((by_name[known] for known in TIME_FIELDS if known in by_name), None)


def seconds_after(values: NDArray[Any], stamp_ns: int, stamped: Stamped = "start") -> Floats | None:
    """Converts times (N,) in any unit and from any origin to seconds (N,) after the scan's stamp.

    Returns None if they carry no information: all equal, not finite, or no unit gives a plausible scan. The unit is the
    one in which the scan's duration is closest to a turn of 0.1 s; integers are never seconds. Times of a clock (after
    1973 in that unit) are taken relative to the stamp, or, if both clocks differ by more than a scan's duration, to the
    first point. Times with another origin (such as power-on, or the GPS week) are taken relative to the first point
    too. Where times count from the first point, the instant that the scan's stamp names tells how long before the stamp
    that was; times before the stamp show that they do not.
    """
    if values.ndim != 1 or values.dtype.kind not in "fiu" or not len(values):
        return None
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        return None
    if values.dtype.kind == "u" and values.dtype.itemsize == 4 and np.ptp(values) > _HALF:  # ns that passed 2^32
        values = values.astype(np.int64)
        values[values < _HALF] += 2 * _HALF
    first = values.min()
    # whole numbers are subtracted as such: ns since 1970 do not fit a float
    span_of = (values - first).astype(np.float64)
    length = float(span_of.max())
    units = _UNITS if values.dtype.kind == "f" else _UNITS[1:]
    fitting = [unit for unit in units if 0.0 < length * unit <= _LONGEST]
    if not fitting:
        return None
    unit = min(fitting, key=lambda u: abs(np.log(length * u / _TURN)))
    begin = float(first) * unit
    if abs(begin) <= _LONGEST:
        return span_of * unit + begin - (BEFORE_STAMP[stamped] * (length * unit + begin) if begin >= 0 else 0.0)
    if begin > _SINCE_1973 and abs(begin - stamp_ns * 1e-9) <= _LONGEST:
        shift = (
            (int(first) * round(unit * 1e9) - stamp_ns) * 1e-9
            if values.dtype.kind != "f"
            else (float(first) * (unit * 1e9) - stamp_ns) * 1e-9
        )
        return span_of * unit + shift
    return (span_of - BEFORE_STAMP[stamped] * length) * unit


class TurnTimes:
    """Makes seconds of times that are fractions of a turn, from 0 to 1: no scan lasts much longer than the interval
    to the next one.

    `remark` is a line for the user where scans seem to last longer, or come faster than a LiDAR turns.
    """

    def __init__(self) -> None:
        self.remark: str | None = None
        self._stamps = deque[int](maxlen=9)

    def in_seconds(self, stamp_ns: int, times: Floats | None, following: Callable[[], Sequence[int]]) -> Floats | None:
        """The times (N,) of the next scan, seconds after its stamp. `following` yields the stamps after it that are
        known; if there are none, nor any before, a turn takes 0.1 s.
        """
        self._stamps.append(stamp_ns)
        interval = _interval(self._stamps)
        if len(self._stamps) == self._stamps.maxlen and interval < _QUICKEST:
            self.remark = (
                f"scans are {interval:.2g} s apart, faster than any LiDAR turns: such parts of a turn hardly fit the "
                "map; let the driver publish whole turns, 5 to 20 a second"
            )
        length = 0.0 if times is None else float(np.ptp(times))
        if times is None or length <= _MUCH * _TURN:
            return times
        interval = _interval([*self._stamps, *following()])
        if length <= _MUCH * interval:
            return times
        fractions = 0.5 < length <= 1 + _ROUNDED and np.abs(times).max() <= 1 + _ROUNDED
        taken = "taken for fractions of that" if fractions else "taken as they are: scans overlap"
        self.remark = self.remark or (
            f"the times of the points span {length:.3g}, scans are {interval:.3g} s apart: the times are {taken}"
        )
        return times * interval if fractions else times


def _interval(stamps_ns: Iterable[int]) -> float:
    """The median interval between the stamps that increase, s; that of a turn if there are none."""
    steps = [(b - a) * 1e-9 for a, b in pairwise(stamps_ns) if b > a]
    return float(np.median(steps)) if steps else _TURN
