"""Bags of scans, written by rosbags: PointCloud2 in the layouts of several drivers, and Livox's CustomMsg."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

NS = 1_000_000_000
START = 1_700_000_000 * NS
CLOUD = "sensor_msgs/msg/PointCloud2"
_KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
_CUSTOM_POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
_CUSTOM = "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
_POINTS = "livox_ros_driver2/CustomPoint[] points\n"
LIVOX = "livox_ros_driver2/msg/CustomMsg"


def store(ros1: bool = False) -> Any:
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(_CUSTOM_POINT, "livox_ros_driver2/msg/CustomPoint"))
    types.register(get_types_from_msg(_CUSTOM + _POINTS, LIVOX))
    return types


def scan_points(k: int, count: int = 40) -> NDArray[np.float32]:
    return np.random.default_rng(k).normal(size=(count, 3)).astype(np.float32) * 5


def header(types: Any, stamp_ns: int) -> Any:
    stamp = types.types["builtin_interfaces/msg/Time"](stamp_ns // NS, stamp_ns % NS)
    more = {"seq": 0} if "seq" in types.types["std_msgs/msg/Header"].__annotations__ else {}
    return types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar", **more)


def cloud(
    types: Any, points: NDArray[Any], stamp_ns: int, time: tuple[str, NDArray[Any]] | None = None, **layout: Any
) -> Any:
    """A PointCloud2: with `padding` bytes after x, y, z, `row_padding` after each of `height` rows, `ring`, `order`."""
    order, height, padding = layout.get("order", "<"), layout.get("height", 1), layout.get("padding", 4)
    fields = [(axis, "f4") for axis in "xyz"] + [("pad", f"V{padding}")] * (padding > 0)
    fields += [] if time is None else [(time[0], time[1].dtype.str[1:])]
    fields += [("ring", "u2")] * layout.get("ring", False)
    dtype = np.dtype([(name, order + kind) for name, kind in fields])
    rows = np.zeros(len(points), dtype)
    for axis, column in zip("xyz", points.T, strict=True):
        rows[axis] = column
    if time is not None:
        rows[time[0]] = time[1]
    width = len(points) // height
    rest = b"\xff" * layout.get("row_padding", 0)
    packed = [rows[k * width : (k + 1) * width].tobytes() + rest for k in range(height)]
    kinds = [(name, dtype.fields[name][1], _KINDS[kind]) for name, kind in fields if kind in _KINDS]  # type: ignore[index]
    point_fields = [types.types["sensor_msgs/msg/PointField"](name, at, kind, 1) for name, at, kind in kinds]
    head, data, big = header(types, stamp_ns), np.frombuffer(b"".join(packed), np.uint8), order == ">"
    return types.types[CLOUD](head, height, width, point_fields, big, dtype.itemsize, len(packed[0]), data, False)


def livox(types: Any, points: NDArray[np.float32], offsets: NDArray[np.uint32], stamp_ns: int) -> Any:
    point = types.types["livox_ros_driver2/msg/CustomPoint"]
    made = [point(int(t), *map(float, p), 9, 16, 3) for p, t in zip(points, offsets, strict=True)]
    return types.types[LIVOX](header(types, stamp_ns), stamp_ns, len(points), 1, np.zeros(3, np.uint8), made)


def imu(types: Any, stamp_ns: int, gyro: NDArray[np.float64], accel: NDArray[np.float64]) -> Any:
    """A sensor_msgs/Imu with rates (3,) and specific forces (3,)."""
    vector, quaternion = (types.types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion"))
    head, turn, unknown = header(types, stamp_ns), quaternion(0.0, 0.0, 0.0, 1.0), np.zeros(9)
    rates, forces = vector(*map(float, gyro)), vector(*map(float, accel))
    return types.types["sensor_msgs/msg/Imu"](head, turn, unknown, rates, unknown, forces, unknown)


def write_bag(path: Path, kind: str, topics: dict[str, list[tuple[int, Any]]]) -> Path:
    """`kind`: ros1, ros1-bz2, ros1-lz4, sqlite3, mcap, sqlite3-zstd. `topics`: messages with the times of recording."""
    form, _, compression = kind.partition("-")
    types = store(form == "ros1")
    writer: Any
    if form == "ros1":
        writer = Ros1Writer(path)
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        writer.chunk_threshold = 1 << 13
    else:
        plugin = StoragePlugin.SQLITE3 if form == "sqlite3" else StoragePlugin.MCAP
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    serialize = types.serialize_ros1 if form == "ros1" else types.serialize_cdr
    with writer:
        connections = {t: writer.add_connection(t, m[0][1].__msgtype__, typestore=types) for t, m in topics.items()}
        rows = [(log_ns, topic, message) for topic, messages in topics.items() for log_ns, message in messages]
        for log_ns, topic, message in sorted(rows, key=lambda row: row[0]):
            writer.write(connections[topic], log_ns, serialize(message, message.__msgtype__))
    return path


def lidar_bag(path: Path, kind: str, count: int = 20, topic: str = "/points", points: int = 40) -> Path:
    """A bag of `count` scans of `scan_points`, 0.1 s apart, with times as Ouster writes them."""
    types = store(kind.startswith("ros1"))
    times = ("t", np.linspace(0, 99_000_000, points).astype(np.uint32))
    stamps = [START + k * NS // 10 for k in range(count)]
    messages = [(s + 5_000_000, cloud(types, scan_points(k, points), s, times)) for k, s in enumerate(stamps)]
    return write_bag(path, kind, {topic: messages})
