"""Bags of messages: ROS 1 (.bag), ROS 2 (a folder with sqlite3 or MCAP files, or one such file), MCAP of any origin.

Those that were cut off are read in the file's order, without its index.
"""

import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import quote

from data.common.errors import UserError, reason
from data.common.files import natural_key

LARGEST_RECORD = 1 << 30  # bytes: writers make chunks of some MB
_ZSTD = b"\x28\xb5\x2f\xfd"  # begins a message of a bag that compresses each, which only its metadata.yaml says
BAG_SUFFIXES = (".bag", ".mcap", ".db3")
_FOREIGN = "Profile is not ros2"  # what rosbags says of an MCAP file that was not recorded by ROS 2: nothing is wrong


class Record(NamedTuple):
    """A message as stored in a bag; `is_cdr`: serialised as in ROS 2, otherwise as in ROS 1."""

    topic: str
    msgtype: str
    is_cdr: bool
    log_ns: int
    data: bytes


def normal_type(name: str) -> str:
    """Normalises a type: `sensor_msgs/PointCloud2` becomes `sensor_msgs/msg/PointCloud2`."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[-1]}" if len(parts) > 1 else name


def _records_in(path: Path) -> Iterator[Record]:
    """Those of a bag's file, in its order."""
    if path.suffix.lower() == ".db3":
        yield from _sqlite(path)
        return
    with path.open("rb") as file:
        if file.read(13) == b"#ROSBAG V2.0\n":
            yield from _ros1(file, path.stat().st_size, {})
            return
        file.seek(0)
        yield from _mcap(file)


def _mcap(file: BinaryIO) -> Iterator[Record]:
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    types, kinds = dict[int, str](), dict[int, tuple[str, str, bool]]()
    for record in StreamReader(file, validate_crcs=True, record_size_limit=LARGEST_RECORD).records:
        if isinstance(record, Schema):
            types[record.id] = normal_type(record.name)
        elif isinstance(record, Channel):
            kinds[record.id] = record.topic, types.get(record.schema_id, ""), record.message_encoding != "ros1"
        elif isinstance(record, Message) and record.channel_id in kinds:
            yield Record(*kinds[record.channel_id], record.log_time, _unpacked(record.data))


def _ros1(file: BinaryIO, end: int, kinds: dict[int, tuple[str, str, bool]]) -> Iterator[Record]:
    """Source: wiki.ros.org/Bags/Format/2.0. `kinds` are the topics and types of the connections so far."""
    from rosbags.rosbag1.reader import Header, RecordType, decompressors, read_bytes, read_uint32

    while file.tell() < end:
        head = Header.read(file)
        data, op = read_bytes(file, read_uint32(file)), head.get_uint8("op")
        if op == RecordType.CHUNK:
            chunk = decompressors[head.get_string("compression")](data)
            yield from _ros1(BytesIO(chunk), len(chunk), kinds)
        elif op == RecordType.CONNECTION:
            about = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
            kinds[head.get_uint32("conn")] = head.get_string("topic"), normal_type(about.get_string("type")), False
        elif op == RecordType.MSGDATA and (kind := kinds.get(head.get_uint32("conn"))):
            yield Record(*kind, head.get_time("time"), data)


def _sqlite(path: Path) -> Iterator[Record]:
    """From rosbag2's tables `topics` and `messages`."""
    address = f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True, check_same_thread=False)) as bag:
        bag.execute("PRAGMA writable_schema = ON")  # else sqlite opens no file that was cut off
        topics = bag.execute("SELECT id, name, type, serialization_format FROM topics")
        kinds = {number: (str(name), normal_type(str(kind)), form == "cdr") for number, name, kind, form in topics}
        for number, log_ns, data in bag.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
            if number in kinds and isinstance(log_ns, int) and isinstance(data, bytes):
                yield Record(*kinds[number], log_ns, _unpacked(data))


def _unpacked(message: bytes) -> bytes:
    if not message.startswith(_ZSTD):
        return message
    import zstandard

    return zstandard.decompress(message, LARGEST_RECORD)


def is_bag(path: Path) -> bool:
    """Whether a file or a folder is a bag by its name or by the names in it."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_bags_in(path))
    return path.suffix.lower() in BAG_SUFFIXES or path.name.lower().endswith(".bag.active")


def _bags_in(folder: Path) -> list[Path]:
    files = (p for p in folder.iterdir() if p.is_file() and is_bag(p) and not p.name.startswith("."))
    return sorted(files, key=lambda p: natural_key(p.name))


class Bag:
    """The messages of some types in a bag: all of its parts, in their order. `counts` are those of each topic."""

    def __init__(self, path: Path | str, types: Collection[str]) -> None:
        """Raises UserError for a path that does not exist."""
        self.path = Path(path)
        if not self.path.exists():
            raise UserError(f"{self.path}: does not exist; give a bag (.bag, .mcap, .db3, or a ROS 2 bag's folder)")
        one = not self.path.is_dir() or (self.path / "metadata.yaml").is_file()
        self._parts = [_Part(p, frozenset(types)) for p in ([self.path] if one else _bags_in(self.path))]
        self.counts: Counter[str] = Counter()
        for part in self._parts:
            self.counts.update(part.counts())

    @property
    def listed(self) -> str:
        """The topics with their numbers of messages, for a user."""
        return ", ".join(f"{name} ({count})" for name, count in sorted(self.counts.items()))

    def topic(self, wanted: str | None, among: Collection[str], option: str, what: str) -> str:
        """The topic that the user's `option` names, with or without its leading slash, else the only one of these.

        Raises UserError, which names `what` the bag lacks or has several of.
        """
        found = [n for n in self.counts if n.strip("/") == wanted.strip("/")] if wanted is not None else list(among)
        if len(found) == 1:
            return found[0]
        if wanted is None:
            raise UserError(f"{self.path}: several topics with {what}: {self.listed}; choose one with {option} NAME")
        raise UserError(f"{option} {wanted}: no such topic with {what} in {self.path}; there are: {self.listed}")

    @property
    def damage(self) -> str:
        """What could not be read of its first damaged file, after a semicolon; empty if all could."""
        return next((f"; {part.damage}" for part in self._parts if part.damage), "")

    def messages(self, topic: str) -> Iterator[Record]:
        """The topic's messages in the order of time, as far as they can be read."""
        for part in self._parts:
            yield from part.messages(topic)

    def damages(self) -> dict[Path, str]:
        """What could not be read so far, by file."""
        return {part.path: part.damage for part in self._parts if part.damage}


@dataclass
class _Part:
    """One file, or a ROS 2 bag's folder: read by rosbags, from where that fails in the file's order."""

    path: Path
    types: frozenset[str]
    damage: str | None = None

    def counts(self) -> Counter[str]:
        """The number of messages by topic."""
        try:
            found: Counter[str] = Counter()
            with _reader(self.path) as reader:
                kinds = {(c.topic, normal_type(c.msgtype)): c.msgcount for c in reader.connections}
                for (topic, msgtype), count in kinds.items():
                    found[topic] += count if msgtype in self.types else 0
        except Exception as error:  # rosbags raises many kinds on garbage
            self._failed(error)
            found = Counter(r.topic for r in self._in_order())
        return +found

    def messages(self, topic: str) -> Iterator[Record]:
        last = None
        try:
            with _reader(self.path) as reader:
                wanted = [c for c in reader.connections if c.topic == topic and normal_type(c.msgtype) in self.types]
                is_cdr = {c.id: getattr(c.ext, "serialization_format", "ros1") != "ros1" for c in wanted}
                for connection, log_ns, data in reader.messages(wanted) if wanted else ():
                    yield Record(topic, normal_type(connection.msgtype), is_cdr[connection.id], log_ns, data)
                    last = log_ns
            return
        except Exception as error:
            self._failed(error)
        for record in self._in_order():
            if record.topic == topic and (last is None or record.log_ns > last):
                yield record

    def _in_order(self) -> Iterator[Record]:
        for file in _bags_in(self.path) if self.path.is_dir() else [self.path]:
            try:
                yield from (record for record in _records_in(file) if record.msgtype in self.types)
            except Exception as error:  # each library raises kinds of its own
                self._failed(error)

    def _failed(self, error: Exception) -> None:
        if not str(error).startswith(_FOREIGN):
            self.damage = f"it was cut off or is damaged ({reason(error)})"


def _reader(path: Path) -> Any:
    if path.suffix.lower() in (".bag", ".active"):
        from rosbags.rosbag1 import Reader as Ros1Reader

        return Ros1Reader(path)
    from rosbags.rosbag2 import Reader as Ros2Reader

    return Ros2Reader(path)


def decoded(data: bytes, msgtype: str, is_cdr: bool) -> Any:
    """The standard message that ROS 2 (`is_cdr`) or ROS 1 serialised, as an object with its fields.

    Raises many kinds of exceptions for garbage, as its library does.
    """
    types = _types(is_cdr)
    return types.deserialize_cdr(data, msgtype) if is_cdr else types.deserialize_ros1(data, msgtype)


@cache
def _types(is_cdr: bool) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE if is_cdr else Stores.ROS1_NOETIC)
