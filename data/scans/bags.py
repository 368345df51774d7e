"""Scans in bags, of ROS messages: sensor_msgs/PointCloud2 of any layout, and Livox's CustomMsg."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.bags import Bag, Record, decoded
from data.common.errors import EndOfScansError, UnreadableScanError, UserError, refusing
from data.scans.formats import XYZ
from data.scans.point_times import time_field
from data.scans.scan import Scan, ScanSource, finished
from data.trajectory.stamps import NS

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg", "livox_interfaces/msg/CustomMsg")
CLOUDS = (POINT_CLOUD, *LIVOX)
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # PointField's datatypes
_LIVOX_FIELDS = (("offset_time", "u4"), *((axis, "f4") for axis in XYZ), ("reflectivity", "V1"), ("tag_line", "V2"))
_LIVOX_SIZE, _LIVOX_TURN = 19, 20  # bytes of a point, and from point to point in CDR, which aligns them


@dataclass(frozen=True, eq=False)
class Cloud:
    """A message's points (N, 3) as stored, their times (N,) as stored or None, and its header's stamp (0: never set).

    `is_lidar`: its points carry times or rings, as those of a LiDAR's driver do.
    """

    stamp_ns: int
    points: NDArray[Any]
    times: NDArray[Any] | None
    is_lidar: bool


def read_cloud(data: bytes, msgtype: str, is_cdr: bool) -> Cloud:
    """The points of a message as ROS 2 (`is_cdr`) or ROS 1 serialises it.

    Raises UnreadableScanError where the message does not hold together.
    """
    with refusing("a broken message", kind=UnreadableScanError):
        return _livox(data, is_cdr) if msgtype in LIVOX else _point_cloud(data, is_cdr)


def _point_cloud(data: bytes, is_cdr: bool) -> Cloud:
    message = decoded(data, POINT_CLOUD, is_cdr)
    order = ">" if message.is_bigendian else "<"
    kinds = {f.name: (f.datatype, f.offset) for f in message.fields if f.count in (0, 1) and f.datatype in _NUMBERS}
    if not all(axis in kinds for axis in XYZ):
        raise UnreadableScanError("its points have no fields x, y, z")
    columns = {name: (order + _NUMBERS[kind], offset) for name, (kind, offset) in kinds.items()}
    rows, width, step = message.height, message.width, message.point_step
    # drivers leave row_step as it was before they cut or joined rows; that there is no padding the length says
    padded = rows > 1 and len(message.data) != rows * width * step
    row_step = max(message.row_step, width * step) if padded else width * step
    if rows * width == 0:
        raise UnreadableScanError("it is empty")
    if len(message.data) < (rows - 1) * row_step + width * step:
        raise UnreadableScanError(f"it claims {rows * width} points of {step} bytes and has {len(message.data)} bytes")
    layout = np.dtype(
        {"names": list(columns), "formats": [f for f, _ in columns.values()],
         "offsets": [o for _, o in columns.values()], "itemsize": step}
    )  # fmt: skip
    table: NDArray[Any] = np.ndarray((rows, width), layout, message.data, strides=(row_step, step))
    points = np.stack([table[axis].ravel() for axis in XYZ], axis=1)
    name = time_field(list(columns))
    times = None if name is None else table[name].ravel()
    stamp = message.header.stamp
    ringed = any(ring in columns for ring in ("ring", "line", "channel", "laser_id"))
    return Cloud(stamp.sec * NS + stamp.nanosec, points, times, times is not None or ringed)


def _livox(data: bytes, is_cdr: bool) -> Cloud:
    """Header, uint64 timebase, uint32 point_num, uint8 lidar_id, uint8[3], CustomPoint[]; read by hand, since to make
    an object of each point would take longer than the rest of the run."""
    order = "<" if not is_cdr or data[1] & 1 else ">"
    at = 4  # past the sequence number, or CDR's four bytes, from which it aligns
    sec, nsec, length = struct.unpack_from(f"{order}iII", data, at)
    at += 12 + length
    if is_cdr:
        at += -(at - 4) % 8
    at += 8 + 4 + 4
    (count,) = struct.unpack_from(f"{order}I", data, at)
    at += 4
    turn = _LIVOX_TURN if is_cdr else _LIVOX_SIZE
    if not count:
        raise UnreadableScanError("it is empty")
    if len(data) - at < (count - 1) * turn + _LIVOX_SIZE:
        raise UnreadableScanError(f"it claims {count} points and has {len(data)} bytes")
    layout = np.dtype([(name, order + kind) for name, kind in _LIVOX_FIELDS])
    table: NDArray[Any] = np.ndarray((count,), layout, data, at, (turn,))
    return Cloud(sec * NS + nsec, np.stack([table[axis] for axis in XYZ], axis=1), table["offset_time"].copy(), True)


def is_lidar(record: Record) -> bool:
    """Whether a message holds points as a LiDAR's driver gives them."""
    try:
        return read_cloud(record.data, record.msgtype, record.is_cdr).is_lidar
    except UnreadableScanError:
        return False


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
        lidars = list(counts)
        if len(counts) > 1 and topic is None:
            firsts = {name: next(self._bag.messages(name), None) for name in counts}
            lidars = [name for name, first in firsts.items() if first is not None and is_lidar(first)]
            if len(lidars) == 1:
                others = f"others with points: {self._bag.listed}"
                self.note = f"scans are read from {lidars[0]}, which has a LiDAR's fields; {others}"
        self.topic = self._bag.topic(topic, lidars, "--topic", "scans")
        self._count = counts[self.topic]

    def __len__(self) -> int:
        """How many messages the topic has."""
        return self._count

    def __iter__(self) -> Iterator[Scan]:
        self._records, self._read_so_far, self._unset_logged = self._bag.messages(self.topic), 0, False
        yield from super().__iter__()
        lost = f" of {self._count}" if self._read_so_far < self._count else ""
        for path, damage in self._bag.damages().items():
            self.remarks.append(f"{path}: {damage}; what could be read is used: {self._read_so_far}{lost} scans")

    def _read(self, index: int) -> Scan:
        record = next(self._records, None)
        if record is None:
            raise EndOfScansError
        self._read_so_far = index + 1
        cloud = read_cloud(record.data, record.msgtype, record.is_cdr)
        if not cloud.stamp_ns and record.log_ns and not self._unset_logged:
            self._unset_logged = True
            self.remarks.append(f"{self.topic}: its headers have no stamp; the time of recording is used instead")
        stamp_ns = cloud.stamp_ns or record.log_ns
        return finished(index, stamp_ns, cloud.points, cloud.times, self.path, stamped=self.stamped)
