"""Reads one scan file: KITTI `.bin`, `.pcd`, `.ply`, `.npy`, `.las`, `.laz`.

Sizes in headers are checked against the file's size before memory is allocated. Coordinates are metres in the sensor
frame; NaN and zero returns are still included.
"""

import os
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from data.scans.point_times import time_field
from data.scans.reading_errors import MissingReaderError, UnreadableScanError

Points = NDArray[np.floating]
Times = NDArray[Any] | None  # in whatever unit, from whatever origin: data.scans.point_times

XYZ = ("x", "y", "z")
LONGEST_RECORD = 4096  # values a PCD point may have, padding counted
LZF_BEST_RATIO = 100  # LZF packs at most 264 bytes into 3


def read_points(path: Path) -> Points:
    """Returns the points (N, 3) of `read_timed`."""
    return read_timed(path)[0]


def read_timed(path: Path) -> tuple[Points, Times]:
    """Returns the scan's points (N, 3), float32 or float64 as stored, and their times (N,) as stored, or None.

    Raises UnreadableScanError if anything is wrong with the file, MissingReaderError if an extra is needed.
    """
    try:
        points, times = READERS[path.suffix.lower()](path)
    except MissingReaderError:
        raise
    except UnreadableScanError:
        raise
    except FileNotFoundError:
        raise UnreadableScanError("the file is gone") from None
    except Exception as error:  # parsers raise anything on garbage; one bad scan must not end a run
        lines = str(error).splitlines() or [""]
        raise UnreadableScanError(f"{type(error).__name__}: {lines[0][:120]}") from None
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise UnreadableScanError("its points are not three numbers each")
    return points, times if times is not None and times.shape == (len(points),) else None


def _read_bin(path: Path) -> tuple[Points, Times]:
    if (size := path.stat().st_size) % 16:
        raise UnreadableScanError(f"{size} bytes are not a whole number of float32 x y z intensity")
    return np.fromfile(path, dtype="<f4").reshape(-1, 4)[:, :3], None


def _read_npy(path: Path) -> tuple[Points, Times]:
    # mapped, because mapping refuses a header that claims more than the file holds, and pickled objects
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind != "f":
        raise UnreadableScanError(f"shape {array.shape}, type {array.dtype}; (N, 3 or more) floats needed")
    return np.array(array[:, :3]), None


def _read_ply(path: Path) -> tuple[Points, Times]:
    from trimesh.exchange.ply import load_ply  # half a second to import, so only where there is a PLY

    size = path.stat().st_size
    with open(path, "rb") as file:
        claimed = re.search(rb"^element\s+vertex\s+(\d+)\s*$", file.read(4096), re.MULTILINE)
        if claimed is None:
            raise UnreadableScanError("its header names no 'element vertex'")
        if (count := int(claimed[1])) > size:
            raise UnreadableScanError(f"its header claims {count} points, the file has {size} bytes")
        file.seek(0)
        if not count:
            return np.empty((0, 3)), None
        mesh = load_ply(file, skip_materials=True)
    points = np.asarray(mesh["vertices"])
    if len(points) != count:
        raise UnreadableScanError(f"cut off: its header claims {count} points, {len(points)} are there")
    vertex = mesh["metadata"]["_ply_raw"]["vertex"]
    name = time_field([str(n) for n in vertex["properties"]])
    return points, None if name is None else np.asarray(vertex["data"][name]).reshape(-1)


def _read_pcd(path: Path) -> tuple[Points, Times]:
    from pypcd4 import Encoding, MetaData, PointCloud

    with open(path, "rb") as file:
        metadata = MetaData.parse_header(_pcd_header(file))
        if sum(metadata.count) > LONGEST_RECORD:
            raise UnreadableScanError(f"its header claims {sum(metadata.count)} values a point")
        columns = [metadata.fields.index(name) for name in XYZ if name in metadata.fields]
        if len(columns) != 3 or {metadata.count[i] for i in columns} != {1}:
            raise UnreadableScanError("it has no fields x, y, z")
        name = time_field(metadata.fields)
        timed = None if name is None or metadata.count[metadata.fields.index(name)] != 1 else name
        if metadata.data == Encoding.ASCII:
            columns += [] if timed is None else [metadata.fields.index(timed)]
            table = _pcd_ascii(file, metadata.points, [sum(metadata.count[:i]) for i in columns])
            return table[:, :3], None if timed is None else table[:, 3]
        claimed = metadata.points * metadata.build_dtype().itemsize
        _check_pcd_size(file, claimed, compressed=metadata.data != Encoding.BINARY)
        file.seek(0)
        cloud = PointCloud.from_fileobj(file)
        return cloud.numpy(XYZ), None if timed is None else np.array(cloud.pc_data[timed])


def _pcd_header(file: BinaryIO) -> list[str]:
    """The header's lines including DATA; the file is then at the first byte of data."""
    lines: list[str] = []
    while len(lines) < 100:
        raw = file.readline(4096)
        if not raw:
            break
        lines.append(raw.decode().strip())
        if lines[-1].startswith("DATA"):
            return lines
    raise UnreadableScanError("no PCD header")


def _pcd_ascii(file: BinaryIO, count: int, columns: list[int]) -> Points:
    if count * 2 * len(columns) > _bytes_left(file) + 1:
        raise UnreadableScanError(f"cut off: its header claims {count} points")
    # not pypcd4's: it takes a line that ends with a blank, or has two between numbers, for a longer one
    points = np.loadtxt(file, usecols=columns, ndmin=2, comments=None) if count else np.empty((0, len(columns)))
    if len(points) != count:
        raise UnreadableScanError(f"cut off: its header claims {count} points, {len(points)} are there")
    return points


def _check_pcd_size(file: BinaryIO, claimed: int, compressed: bool) -> None:
    there = _bytes_left(file)
    if compressed and claimed:
        packed, unpacked = struct.unpack("<II", file.read(8))
        if packed > there - 8 or unpacked != claimed or unpacked > LZF_BEST_RATIO * packed:
            raise UnreadableScanError(f"its header claims {claimed} bytes of points, packed into {there - 8}")
    elif claimed > there:
        raise UnreadableScanError(f"cut off: its header claims {claimed} bytes of points, {there} are there")


def _bytes_left(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size - file.tell()


def _read_las(path: Path) -> tuple[Points, Times]:
    from data.scans.las import read_las

    return read_las(path)


READERS: dict[str, Callable[[Path], tuple[Points, Times]]] = {
    ".bin": _read_bin,
    ".las": _read_las,
    ".laz": _read_las,
    ".npy": _read_npy,
    ".pcd": _read_pcd,
    ".ply": _read_ply,
}
