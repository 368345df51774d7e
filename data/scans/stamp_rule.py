"""Decides which scans' stamps can be used: not those that repeat, go back, or are far ahead of their followers."""

from collections.abc import Callable, Sequence

from data.trajectory.stamps import NS, ns_to_seconds

LOOK_AHEAD = 8  # next scans that decide whether a stamp far ahead is right
GAP_NS = 10 * NS  # longer pauses between scans are reported


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
