"""Reads bags record by record as far as possible: not closed properly, truncated or damaged.

ROS 1: wiki.ros.org/Bags/Format/2.0. MCAP: mcap.dev/spec. sqlite3: rosbag2's tables `topics` and `messages`.
"""

import sqlite3
import struct
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import quote

LARGEST_CHUNK = 1 << 30  # bytes: writers make chunks of some MB
_PIECE = 1 << 20  # bytes read from a pipe at once
_MAGIC_1, _MAGIC_MCAP = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n"


class Record(NamedTuple):
    """A message as stored in a bag; `is_cdr`: serialised as in ROS 2, otherwise as in ROS 1."""

    topic: str
    msgtype: str
    is_cdr: bool
    log_ns: int
    data: bytes


@dataclass
class Recovery:
    """Iterates over the messages in the file's order; afterwards `damage` says what could not be read, if anything."""

    path: Path
    damage: str | None = None
    _kinds: dict[int, tuple[str, str, bool]] = field(default_factory=dict)  # connection or channel: topic, type, is CDR
    _schemas: dict[int, str] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Record]:
        self.damage = None
        self._kinds, self._schemas = {}, {}
        try:
            if self.path.suffix.lower() == ".db3":
                yield from self._sqlite()
                return
            with self.path.open("rb") as file:
                magic = file.read(len(_MAGIC_1))
                if magic == _MAGIC_1:
                    yield from self._ros1(file, self.path.stat().st_size)
                elif magic.startswith(_MAGIC_MCAP):
                    file.seek(len(_MAGIC_MCAP))
                    yield from self._mcap(file, self.path.stat().st_size)
                else:
                    self.damage = "it does not start like a bag"
        except (struct.error, UnicodeDecodeError, LookupError, ValueError) as error:
            self.damage = f"it is damaged ({type(error).__name__}: {error})"
        except sqlite3.Error as error:
            self.damage = f"it is damaged ({error})"

    def piped(self, file: BinaryIO) -> Iterator[Record]:
        """The messages of an MCAP file that is read from a pipe, each as soon as it is there; `damage` as above."""
        self.damage = None
        self._kinds, self._schemas = {}, {}
        try:
            if not file.read(len(_MAGIC_MCAP)).startswith(_MAGIC_MCAP):
                self.damage = "it does not start like MCAP"
                return
            yield from self._mcap(_Forward(file), sys.maxsize)
        except (struct.error, UnicodeDecodeError, LookupError, ValueError) as error:
            self.damage = f"it is damaged or was cut off ({type(error).__name__}: {error})"

    def _ros1(self, file: BinaryIO, end: int) -> Iterator[Record]:
        while file.tell() < end:
            head = _ros1_fields(_block(file, "<I", end))
            (size,) = struct.unpack("<I", _exactly(file, 4))
            op = head["op"][0]
            if op == 5:  # a chunk; what there is of the last one is used
                there = file.read(min(size, end - file.tell()))
                self.damage = "it was cut off" if len(there) < size else self.damage
                (unpacked,) = struct.unpack("<I", head["size"])
                inner, whole = _unpacked(head["compression"].decode(), there, unpacked)
                self.damage = self.damage if whole else "a part of it cannot be decompressed"
                yield from self._inner_ros1(inner)
            elif op in (2, 7):
                if size > end - file.tell():
                    self.damage = "it was cut off"
                    return
                yield from self._ros1_record(op, head, file.read(size))
            else:
                file.seek(size, 1)

    def _inner_ros1(self, chunk: bytes) -> Iterator[Record]:
        at = 0
        while at + 4 <= len(chunk):
            (length,) = struct.unpack_from("<I", chunk, at)
            start = at + 4 + length
            if start + 4 > len(chunk):
                break
            head = _ros1_fields(chunk[at + 4 : start])
            (size,) = struct.unpack_from("<I", chunk, start)
            at = start + 4 + size
            if at > len(chunk):
                break
            yield from self._ros1_record(head["op"][0], head, chunk[start + 4 : at])

    def _ros1_record(self, op: int, head: dict[str, bytes], data: bytes) -> Iterator[Record]:
        (number,) = struct.unpack("<I", head["conn"])
        if op == 7:
            kind = _ros1_fields(data)["type"].decode()
            self._kinds[number] = (head["topic"].decode(), normal_type(kind), False)
        elif op == 2 and number in self._kinds:
            sec, nsec = struct.unpack("<II", head["time"])
            yield Record(*self._kinds[number], sec * 1_000_000_000 + nsec, data)

    def _mcap(self, file: "BinaryIO | _Forward", end: int) -> Iterator[Record]:
        while True:
            head = file.read(9)
            if len(head) < 9:
                self.damage = "it was cut off"
                return
            op, size = struct.unpack("<BQ", head)
            if op in (0x02, 0x0F):  # the data end here
                return
            there = min(size, end - file.tell())
            if op != 0x06 and there < size:
                self.damage = "it was cut off"
                return
            if op in (0x03, 0x04, 0x05, 0x06):
                yield from self._mcap_record(op, file.read(there))
            else:
                file.seek(there, 1)

    def _mcap_record(self, op: int, data: bytes) -> Iterator[Record]:
        if op == 0x03:
            (number,) = struct.unpack_from("<H", data)
            self._schemas[number] = _text(data, 2)[0]
        elif op == 0x04:
            number, schema = struct.unpack_from("<HH", data)
            topic, at = _text(data, 4)
            encoding, _ = _text(data, at)
            self._kinds[number] = (topic, normal_type(self._schemas.get(schema, "")), encoding != "ros1")
        elif op == 0x05:
            number, _, log_ns, _ = struct.unpack_from("<HIQQ", data)
            if number in self._kinds:
                yield Record(*self._kinds[number], log_ns, _plain(data[22:]))
        else:
            size, crc = struct.unpack_from("<QI", data, 16)
            compression, at = _text(data, 28)
            (packed,) = struct.unpack_from("<Q", data, at)
            inner, whole = _unpacked(compression, data[at + 8 : at + 8 + packed], size)
            if not whole or (crc and zlib.crc32(inner) != crc):
                self.damage = "a part of it cannot be decompressed"
                if whole:
                    return
            yield from self._inner_mcap(inner)

    def _inner_mcap(self, chunk: bytes) -> Iterator[Record]:
        at = 0
        while at + 9 <= len(chunk):
            op, size = struct.unpack_from("<BQ", chunk, at)
            at += 9 + size
            if at > len(chunk):
                break
            if op in (0x03, 0x04, 0x05):
                yield from self._mcap_record(op, chunk[at - size : at])

    def _sqlite(self) -> Iterator[Record]:
        address = f"file:{quote(str(self.path.resolve()))}?mode=ro&immutable=1"
        connection = sqlite3.connect(address, uri=True, check_same_thread=False)
        try:
            connection.execute("PRAGMA writable_schema = ON")  # else sqlite opens no file that was cut off
            topics = connection.execute("SELECT id, name, type, serialization_format FROM topics")
            kinds = {i: (str(name), normal_type(str(kind)), form == "cdr") for i, name, kind, form in topics}
            rows = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
            for number, log_ns, data in rows:
                if number in kinds and isinstance(log_ns, int) and isinstance(data, bytes):
                    yield Record(*kinds[number], log_ns, _plain(data))
        finally:
            connection.close()


class _Forward:
    """A pipe as a file that is only read onwards."""

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe, self._at = pipe, 0

    def read(self, size: int) -> bytes:
        """Piece by piece: a damaged size takes no more memory than what there is."""
        pieces = []
        while size > 0 and (piece := self._pipe.read(min(size, _PIECE))):
            pieces.append(piece)
            size -= len(piece)
            self._at += len(piece)
        return b"".join(pieces)

    def seek(self, size: int, whence: int) -> None:
        assert whence == 1
        while size > 0 and (skipped := self.read(min(size, _PIECE))):
            size -= len(skipped)

    def tell(self) -> int:
        return self._at


def normal_type(name: str) -> str:
    """Normalises a type: `sensor_msgs/PointCloud2` becomes `sensor_msgs/msg/PointCloud2`."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[-1]}" if len(parts) > 1 else name


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise ValueError("it was cut off")
    return data


def _block(file: BinaryIO, form: str, end: int) -> bytes:
    (size,) = struct.unpack(form, _exactly(file, struct.calcsize(form)))
    if size > end - file.tell():
        raise ValueError("it was cut off")
    return _exactly(file, size)


def _ros1_fields(data: bytes) -> dict[str, bytes]:
    """The `name=value` pairs of a record's header."""
    fields, at = {}, 0
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        name, _, value = data[at + 4 : at + 4 + size].partition(b"=")
        fields[name.decode()] = value
        at += 4 + size
    return fields


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A string preceded by its length, and where it ends."""
    (size,) = struct.unpack_from("<I", data, at)
    return data[at + 4 : at + 4 + size].decode(), at + 4 + size


def _plain(message: bytes) -> bytes:
    """The message of a bag that compresses each message, as stated only in its metadata.yaml."""
    if not message.startswith(b"\x28\xb5\x2f\xfd"):
        return message
    return _unpacked("zstd", message, LARGEST_CHUNK)[0]


def _unpacked(compression: str, data: bytes, size: int) -> tuple[bytes, bool]:
    """The part of a chunk that can be unpacked, and whether that is all of its `size` bytes."""
    if compression in ("", "none"):
        return data, len(data) >= size
    unpacker = _unpacker(compression)
    if unpacker is None or size > LARGEST_CHUNK:
        return b"", False
    parts, room = [], size
    try:
        for start in range(0, len(data), 65536):  # in pieces, so that what comes before damage is had
            parts.append(unpacker.decompress(data[start : start + 65536], room))
            room -= len(parts[-1])
            while room and not unpacker.needs_input and not unpacker.eof and parts[-1]:
                parts.append(unpacker.decompress(b"", room))
                room -= len(parts[-1])
            if unpacker.eof or room <= 0:
                break
    except Exception:  # each library raises its own kinds; what came out before stays
        return b"".join(parts), False
    return b"".join(parts), room <= 0


def _unpacker(compression: str) -> Any:
    if compression == "bz2":
        import bz2

        return bz2.BZ2Decompressor()
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor()
    if compression == "zstd":
        if sys.version_info >= (3, 14):
            from compression import zstd
        else:
            from backports import zstd

        return zstd.ZstdDecompressor()
    return None
