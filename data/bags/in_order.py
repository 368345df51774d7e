"""Messages of bags in the file's order, without its index: of bags that were cut off or come through a pipe.

Each function yields the messages that are whole, and raises what its library does where the rest cannot be read.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple
from urllib.parse import quote

LARGEST_RECORD = 1 << 30  # bytes: writers make chunks of some MB
_ZSTD = b"\x28\xb5\x2f\xfd"  # begins a message of a bag that compresses each, which only its metadata.yaml says


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


def records_in(path: Path) -> Iterator[Record]:
    """Those of a bag's file."""
    if path.suffix.lower() == ".db3":
        yield from _sqlite(path)
        return
    with path.open("rb") as file:
        if file.read(13) == b"#ROSBAG V2.0\n":
            yield from _ros1(file, path.stat().st_size, {})
            return
        file.seek(0)
        yield from mcap_records(file)


def mcap_records(file: BinaryIO) -> Iterator[Record]:
    """Those of MCAP, each as soon as its record or chunk is there."""
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
