"""Scans of an MCAP file that comes through a pipe, record by record."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from data.bags import Record, mcap_records, reason
from data.common.errors import UserError
from data.scans.cloud_messages import CLOUDS, read_cloud
from data.scans.reading_errors import UnreadableScanError
from data.scans.scan import finished
from data.streams.arrivals import Arrival, ScanStream


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
