"""What all sources of scans that are still coming have in common."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from data.scans import Scan
from data.scans.point_times import Stamped, TurnTimes
from data.scans.scan import SkippedScan
from data.scans.stamp_rule import GAP_NS, StampRule


@dataclass(frozen=True, eq=False)
class Arrival:
    """A scan, and the reading of `time.perf_counter` at which all of it was there, before it was read."""

    scan: Scan
    came_s: float


class ScanStream(ABC):
    """Scans in the order in which they come; iterating waits for the next one until the source ends or `stop` is set.

    `skipped` lists the scans that could not be used, so far; `remarks` are lines on the data for the user; `stamped` is
    the instant of a scan that its stamp names.
    """

    stamped: Stamped = "start"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stop = threading.Event()
        self.skipped: list[SkippedScan] = []
        self.remarks: list[str] = []

    @abstractmethod
    def _arrivals(self) -> Iterator[Arrival]:
        """All scans that can be read; the others go to `_skip`."""

    def __iter__(self) -> Iterator[Arrival]:
        """Yields the scans whose stamps increase.

        After a pause of more than ten seconds, a scan waits for the next one: if its stamp was wrong, only it is lost.
        """
        rule, turns = StampRule(), TurnTimes()
        for arrival, following_ns in _with_next_after_pause(self._arrivals()):
            scan, stamp_ns = arrival.scan, arrival.scan.stamp_ns
            if reason := rule.judge(scan.index, stamp_ns, following_ns.copy):
                self._skip(scan.index, scan.path, reason)
            else:
                times = turns.in_seconds(stamp_ns, scan.point_times, following_ns.copy)
                yield replace(arrival, scan=replace(scan, point_times=times))
        self.remarks.extend(remark for remark in (rule.remark(), turns.remark) if remark)

    def _skip(self, index: int, path: Path, reason: str) -> None:
        name = path.name if path != self.path else f"scan {index}"
        self.skipped.append(SkippedScan(index, path, reason, name))


def _with_next_after_pause(arrivals: Iterable[Arrival]) -> Iterator[tuple[Arrival, list[int]]]:
    """Each arrival and, where it comes after a pause, the stamp of the next one."""
    last_ns: int | None = None
    held: Arrival | None = None
    for arrival in arrivals:
        stamp_ns = arrival.scan.stamp_ns
        if held is not None:
            yield held, [stamp_ns]
            last_ns = min(held.scan.stamp_ns, stamp_ns)
            held = None
        if last_ns is not None and stamp_ns - last_ns > GAP_NS:
            held = arrival
            continue
        last_ns = stamp_ns
        yield arrival, []
    if held is not None:
        yield held, []
