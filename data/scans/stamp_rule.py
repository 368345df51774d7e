"""Which scans' stamps can be used: a repeated one, one that goes back and one far ahead of its followers cannot."""

from collections.abc import Callable, Sequence

from data.trajectory.stamps import NS, ns_to_seconds

LOOK_AHEAD = 8  # scans that are asked whether a stamp far ahead is right
GAP_NS = 10 * NS  # a longer pause between scans is told to the user


class StampRule:
    """Judges stamps (ns) one after the other.

    A single wrong stamp costs its own scan: one far ahead is not believed where most of the next scans come before it.
    """

    def __init__(self) -> None:
        self.last_ns: int | None = None
        self.gaps: list[tuple[int, int, int]] = []  # (index, stamp before, stamp after)

    def judge(self, index: int, stamp_ns: int, following: Callable[[], Sequence[int]]) -> str | None:
        """Why this scan cannot be used, or None. `following` gives the stamps of the next scans, at most LOOK_AHEAD."""
        last = self.last_ns
        if last is not None and stamp_ns <= last:
            how = "repeats" if stamp_ns == last else f"goes back by {ns_to_seconds(last - stamp_ns)} s from"
            return f"its stamp {how} that of the scan before ({ns_to_seconds(last)} s)"
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
        """One line on long pauses, None where there was none."""
        if not self.gaps:
            return None
        index, before, after = max(self.gaps, key=lambda gap: gap[2] - gap[1])
        more = f"; there are {len(self.gaps) - 1} more such pauses" if len(self.gaps) > 1 else ""
        return (
            f"no scans for {ns_to_seconds(after - before).rstrip('0').rstrip('.')} s before scan {index}: where the "
            f"sensor was moved meanwhile, the map has a break there{more}"
        )


def unusable(stamps_ns: Sequence[int]) -> int:
    """How many of all scans' stamps cannot be used."""
    rule = StampRule()

    def judge(index: int, stamp_ns: int) -> str | None:
        return rule.judge(index, stamp_ns, lambda: stamps_ns[index + 1 : index + 1 + LOOK_AHEAD])

    return sum(judge(index, stamp_ns) is not None for index, stamp_ns in enumerate(stamps_ns))
