"""Scans in bags."""

from collections.abc import Callable, Iterator
from itertools import repeat
from pathlib import Path

from data.bags import Bag
from data.common.errors import EndOfScansError, UnreadableScanError, UserError
from data.scans.cloud_messages import CLOUDS, read_cloud
from data.scans.scan import Scan, ScanSource, finished


class BagScans(ScanSource):
    """The scans of one topic, streamed. Their stamps are those of the headers, else the bag's."""

    def __init__(self, path: Path | str, topic: str | None = None) -> None:
        """Opens the bag and settles the topic; `topic` None takes the only one with scans, or the only LiDAR's.

        Raises UserError where the bag cannot be read or has no scans, and where the topic is none of its topics or,
        without one being named, several could be meant.
        """
        super().__init__()
        self._bag = Bag(path, CLOUDS)
        self.path, counts = self._bag.path, self._bag.counts
        if not counts:
            give = "repair it ('rosbag reindex', 'mcap recover')" if self._bag.damage else "give a bag with scans"
            raise UserError(f"{self.path}: no scans (PointCloud2 or Livox CustomMsg){self._bag.damage}; {give}")
        self.topic = self._choose(topic)
        self._count = counts[self.topic]
        self._unset_logged, self._told = False, set[Path]()

    def __len__(self) -> int:
        """How many messages the topic has."""
        return self._count

    def _choose(self, wanted: str | None) -> str:
        bag = self._bag
        if wanted is not None:
            return bag.named(wanted, "--topic", "topic with scans")
        lidars = list(bag.counts) if len(bag.counts) == 1 else [name for name in bag.counts if self._is_lidar(name)]
        if len(lidars) != 1:
            raise UserError(f"{self.path}: several topics hold points: {bag.listed}; choose one with --topic NAME")
        if len(bag.counts) > 1:
            self.note = f"scans are read from {lidars[0]}, which has a LiDAR's fields; others with points: {bag.listed}"
        return lidars[0]

    def _is_lidar(self, topic: str) -> bool:
        record = next(self._bag.messages(topic), None)
        try:
            return record is not None and read_cloud(record.data, record.msgtype, record.is_cdr).is_lidar
        except UnreadableScanError:
            return False

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        self._index, self._unset_logged = 0, False
        self._records = self._bag.messages(self.topic)
        return repeat(self._next)

    def _next(self) -> Scan:
        record = next(self._records, None)
        index, self._index = self._index, self._index + 1
        if record is None:
            self._log_at_end(index)
            raise EndOfScansError
        cloud = read_cloud(record.data, record.msgtype, record.is_cdr)
        if not cloud.stamp_ns and record.log_ns and not self._unset_logged:
            self._unset_logged = True
            self.remarks.append(f"{self.topic}: its headers have no stamp; the time of recording is used instead")
        stamp_ns = cloud.stamp_ns or record.log_ns
        return finished(index, stamp_ns, cloud.points, cloud.times, self.path, stamped=self.stamped)

    def _log_at_end(self, read: int) -> None:
        for path, damage in self._bag.damages().items():
            if path not in self._told:
                lost = f" of {self._count}" if read < self._count else ""
                self.remarks.append(f"{path}: {damage}; what could be read is used: {read}{lost} scans")
                self._told.add(path)
