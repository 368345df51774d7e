"""Sources of scans that are still coming: what they have in common, and an MCAP file that comes through a pipe."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from data.bags import Record, mcap_records, reason
from data.common.errors import UnreadableScanError, UserError
from data.scans import Scan
from data.scans.cloud_messages import CLOUDS, read_cloud
from data.scans.point_times import Stamped, TurnTimes
from data.scans.scan import SkippedScan, finished
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


class McapPipe(ScanStream):
    """The scans of one topic: of `topic`, else of the first one whose points are a LiDAR's by their fields.

    A writer that collects records in chunks delays the scans by as much.
    """

    def __init__(self, file: BinaryIO, topic: str | None = None, name: str = "standard input") -> None:
        super().__init__(Path(name))
        self._file, self._topic, self._damage = file, topic, ""

    def _arrivals(self) -> Iterator[Arrival]:
        """Raises UserError if the pipe ends without a scan."""
        count, others = 0, set[str]()
        for record in self._records():
            came_s = time.perf_counter()
            if self.stop.is_set():
                return
            is_meant = _is_lidar(record) if self._topic is None else record.topic == self._topic
            if record.msgtype not in CLOUDS or not is_meant:
                others.add(record.topic)
                continue
            self._topic, count = record.topic, count + 1
            try:
                cloud = read_cloud(record.data, record.msgtype, record.is_cdr)
                stamp_ns = cloud.stamp_ns or record.log_ns
                scan = finished(count - 1, stamp_ns, cloud.points, cloud.times, self.path, stamped=self.stamped)
            except UnreadableScanError as error:
                self._skip(count - 1, self.path, str(error))
                continue
            yield Arrival(scan, came_s)
        if self._damage:
            self.remarks.append(f"{self.path}: {self._damage}")
        if not count:
            held = f"; it holds {', '.join(sorted(others))}" if others else ""
            why = f" ({self._damage})" if self._damage else ""
            raise UserError(f"{self.path}: no scans arrived{why}{held}; give MCAP records of point clouds")

    def _records(self) -> Iterator[Record]:
        try:
            yield from mcap_records(self._file)
        except Exception as error:  # mcap raises many kinds on garbage
            self._damage = f"it was cut off or is damaged ({reason(error)})"


def _is_lidar(record: Record) -> bool:
    try:
        return read_cloud(record.data, record.msgtype, record.is_cdr).is_lidar
    except UnreadableScanError:
        return False
