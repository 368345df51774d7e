"""Which stamps of scans can be used: not those that repeat, go back, are far ahead of their followers, or in another
unit."""

from collections.abc import Callable, Sequence

import numpy as np

from data.common.errors import UserError
from data.trajectory.stamps import NS, ns_to_seconds

LOOK_AHEAD = 8  # next scans that decide whether a stamp far ahead is right
GAP_NS = 10 * NS  # longer pauses between scans are reported
_FEWEST = 4  # scans: of fewer, a single odd stamp would decide
_SHORTEST, _LONGEST = 0.02, 0.5  # s between the scans of a moving LiDAR
_FASTEST, _SLOWEST = 1e-3, 1e4  # s between any scans: none are faster, nor hours apart
_EVEN = 0.2  # of the median, within which the middle half of a LiDAR's intervals lies; stations are set up less evenly


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


def unusable(stamps_ns: Sequence[int]) -> int:
    """The number of scans whose stamps cannot be used."""
    rule = StampRule()

    def judge(index: int, stamp_ns: int) -> str | None:
        return rule.judge(index, stamp_ns, lambda: stamps_ns[index + 1 : index + 1 + LOOK_AHEAD])

    return sum(judge(index, stamp_ns) is not None for index, stamp_ns in enumerate(stamps_ns))


def check_interval(stamps_ns: Sequence[int], where: str) -> None:
    """Raises UserError if the stamps of scans seem to be in another unit, and names it. `where` says what holds them.

    Scans that are minutes apart are accepted if they are so unevenly: they may be a survey's.
    """
    if len(stamps_ns) < _FEWEST:
        return
    low, interval, high = np.percentile(np.diff(np.array(stamps_ns, dtype=np.float64)) / NS, [25, 50, 75]).tolist()
    if interval <= 0:  # stamps that do not increase are judged elsewhere
        return
    unit = None
    if interval > _SLOWEST:  # taken for seconds
        unit = "microseconds" if interval < _LONGEST * 1e6 else "nanoseconds"
    elif interval < _FASTEST:  # taken for nanoseconds
        unit = "microseconds" if interval > _SHORTEST * 1e-3 else "milliseconds"
    elif _SHORTEST * 1e3 <= interval <= _LONGEST * 1e3 and high - low <= _EVEN * interval:
        unit = "milliseconds"
    if unit is not None:
        raise UserError(
            f"{where}: the scans are {interval:.3g} s apart by their stamps, which seem to be in {unit}; give seconds "
            "in times.txt, in names seconds with a decimal point or nanoseconds"
        )
