"""Scans in bags: ROS 1 (.bag), ROS 2 (a folder with sqlite3 or MCAP files, or one such file), MCAP of any origin."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.scans.bag_records import Record, Recovery, normal_type
from data.scans.cloud_messages import CLOUDS, read_cloud
from data.scans.folder import natural_key
from data.scans.reading_errors import EndOfScansError, UnreadableScanError
from data.scans.scan import Scan, ScanSource, finished

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
_FOREIGN = "Profile is not ros2"  # what rosbags says of an MCAP file that was not recorded by ROS 2: nothing is wrong


def is_bag(path: Path) -> bool:
    """Whether a file or a folder is a bag by its name or by the names in it."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_bags_in(path))
    return path.suffix.lower() in BAG_SUFFIXES or path.name.lower().endswith(".bag.active")


def _bags_in(folder: Path) -> list[Path]:
    files = (p for p in folder.iterdir() if p.is_file() and is_bag(p) and not p.name.startswith("."))
    return sorted(files, key=lambda p: natural_key(p.name))


@dataclass
class _Part:
    """One file, or a ROS 2 bag's folder: read by rosbags, from where that fails record by record."""

    path: Path
    damage: str | None = None

    def kinds(self) -> Counter[tuple[str, str]]:
        """The number of messages by topic and type, of those that hold scans."""
        try:
            with _reader(self.path) as reader:
                found = Counter({(c.topic, normal_type(c.msgtype)): c.msgcount for c in reader.connections})
        except Exception as error:  # rosbags raises many kinds on garbage
            self._failed(error)
            found = Counter((r.topic, r.msgtype) for r in self._recovered())
        return Counter({kind: count for kind, count in found.items() if kind[1] in CLOUDS})

    def messages(self, topic: str) -> Iterator[Record]:
        """The topic's messages in the order of time, as far as they can be read."""
        last = None
        try:
            with _reader(self.path) as reader:
                wanted = [c for c in reader.connections if c.topic == topic and normal_type(c.msgtype) in CLOUDS]
                is_cdr = {c.id: getattr(c.ext, "serialization_format", "ros1") != "ros1" for c in wanted}
                for connection, log_ns, data in reader.messages(wanted) if wanted else ():
                    yield Record(topic, normal_type(connection.msgtype), is_cdr[connection.id], log_ns, data)
                    last = log_ns
            return
        except Exception as error:
            self._failed(error)
        for record in self._recovered():
            if record.topic == topic and record.msgtype in CLOUDS and (last is None or record.log_ns > last):
                yield record

    def _recovered(self) -> Iterator[Record]:
        for file in _bags_in(self.path) if self.path.is_dir() else [self.path]:
            recovery = Recovery(file)
            yield from recovery
            if recovery.damage:
                self.damage = recovery.damage

    def _failed(self, error: Exception) -> None:
        text = (str(error).splitlines() or [""])[0][:120]
        if not text.startswith(_FOREIGN):
            self.damage = text or type(error).__name__


def _reader(path: Path) -> Any:
    if path.suffix.lower() in (".bag", ".active"):
        from rosbags.rosbag1 import Reader as Ros1Reader

        return Ros1Reader(path)
    from rosbags.rosbag2 import Reader as Ros2Reader

    return Ros2Reader(path)


class BagScans(ScanSource):
    """The scans of one topic, streamed. Their stamps are those of the headers, else the bag's."""

    def __init__(self, path: Path | str, topic: str | None = None) -> None:
        """Opens the bag and settles the topic; `topic` None takes the only one with scans, or the only LiDAR's.

        Raises UserError where the bag cannot be read or has no scans, and where the topic is none of its topics or,
        without one being named, several could be meant.
        """
        super().__init__()
        self.path = Path(path)
        if not self.path.exists():
            raise UserError(f"{self.path}: does not exist; give a bag (.bag, .mcap, .db3, or a ROS 2 bag's folder)")
        one = not self.path.is_dir() or (self.path / "metadata.yaml").is_file()
        self._parts = [_Part(p) for p in ([self.path] if one else _bags_in(self.path))]
        counts: Counter[str] = Counter()
        for part in self._parts:
            for (name, _), count in part.kinds().items():
                counts[name] += count
        if not counts.total():
            damage = next((p.damage for p in self._parts if p.damage), None)
            why = f"; {damage}" if damage else ""
            raise UserError(f"{self.path}: no scans in it (PointCloud2 or Livox CustomMsg){why}; give a bag with some")
        self.topic = self._choose(counts, topic)
        self._count = counts[self.topic]
        self._unset_logged = False

    def __len__(self) -> int:
        """How many messages the topic has."""
        return self._count

    def _choose(self, counts: Counter[str], wanted: str | None) -> str:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items()))
        if wanted is not None:
            named = [name for name in counts if name.strip("/") == wanted.strip("/")]
            if not named:
                raise UserError(f"--topic {wanted}: no such topic with scans in {self.path}; there are: {listed}")
            return named[0]
        lidars = list(counts) if len(counts) == 1 else [name for name in counts if self._is_lidar(name)]
        if len(lidars) != 1:
            raise UserError(f"{self.path}: several topics hold points: {listed}; say which with --topic NAME")
        if len(counts) > 1:
            self.note = f"the scans are those of {lidars[0]}, a LiDAR's by its fields; others with points: {listed}"
        return lidars[0]

    def _is_lidar(self, topic: str) -> bool:
        record = next((r for part in self._parts for r in part.messages(topic)), None)
        try:
            return record is not None and read_cloud(record.data, record.msgtype, record.is_cdr).is_lidar
        except UnreadableScanError:
            return False

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        self._index, self._unset_logged = 0, False
        self._records = (record for part in self._parts for record in part.messages(self.topic))
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
            self.remarks.append(f"{self.topic}: headers without a stamp; the time of recording is taken for it")
        return finished(index, cloud.stamp_ns or record.log_ns, cloud.points, cloud.times, self.path)

    def _log_at_end(self, read: int) -> None:
        for part in self._parts:
            if part.damage:
                lost = f" of {self._count}" if read < self._count else ""
                self.remarks.append(f"{part.path}: {part.damage}; what could be read is used: {read}{lost} scans")
                part.damage = None
