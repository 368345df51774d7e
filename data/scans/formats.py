"""Reads one scan file: `.bin`, `.pcd`, `.ply`, `.npy`, `.las`, `.laz`.

Sizes in headers are checked against the file's size before memory is allocated. Coordinates are metres in the sensor
frame; NaN and zero returns are still included.
"""

import math
import os
import re
import struct
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path
from typing import Any, BinaryIO

import lzf
import numpy as np
from numpy.typing import NDArray

from data.common.errors import UnreadableScanError, refusing
from data.scans.point_times import time_field

Points = NDArray[np.floating]
Times = NDArray[Any] | None  # in whatever unit, from whatever origin: data.scans.point_times

XYZ = ("x", "y", "z")
LONGEST_RECORD = 4096  # values a PCD point may have, padding counted
LONGEST_LINE = 4096  # bytes of a line in a PCD's header
LZF_BEST_RATIO = 100  # LZF packs at most 264 bytes into 3
_PCD_ROWS = {  # the words of a header's line: PCL's default for each, their form, and what they are
    "SIZE": ("4", "[1248]", "sizes, each 1, 2, 4 or 8"),
    "TYPE": ("f", "[fuid]", "types, each F, U, I or D"),
    "COUNT": ("1", r"\d{1,9}", "whole numbers"),
    "WIDTH": ("", r"\d{1,12}", "whole number"),
    "HEIGHT": ("1", r"\d{1,12}", "whole number"),
    "POINTS": ("", r"\d{1,12}", "whole number"),
    "DATA": ("", "ascii|binary|binary_compressed", "of ascii, binary, binary_compressed"),
}
_WIDTHS = (4, 3, 5)  # float32 values of a point in a .bin: KITTI; x y z alone; nuScenes
_FEWEST = 300  # values: fewer say nothing about the width
_SEEN = 60_000  # values that are looked at, a multiple of each width


def is_scan(path: Path) -> bool:
    """Whether a file is a scan by its name; hidden ones are not."""
    return path.suffix.lower() in READERS and not path.name.startswith(".")


def read_points(path: Path) -> Points:
    """Returns the points (N, 3) of `read_timed`."""
    return read_timed(path)[0]


def read_timed(path: Path) -> tuple[Points, Times]:
    """Returns the scan's points (N, 3), float32 or float64 as stored, and their times (N,) as stored, or None.

    Raises UnreadableScanError if anything is wrong with the file, UserError if an extra is needed.
    """
    with refusing("a broken file", kind=UnreadableScanError):  # one bad scan must not end a run
        points, times = READERS[path.suffix.lower()](path)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise UnreadableScanError("its points are not three numbers each")
    return points, times if times is not None and times.shape == (len(points),) else None


def _read_bin(path: Path) -> tuple[Points, Times]:
    values = np.fromfile(path, "<f4")
    width = _values_a_point(values)
    if (size := path.stat().st_size) % (4 * width):
        raise UnreadableScanError(
            f"{size} bytes are not a whole number of points of {width} float32: x y z intensity as in KITTI, x y z, or "
            "x y z intensity ring as in nuScenes"
        )
    return values.reshape(-1, width)[:, :3], None


def _values_a_point(values: NDArray[np.float32]) -> int:
    """How many values a point has, in a file that does not say it: 4, unless it certainly has 3 or 5.

    In columns of the right width like stands below like: neighbours differ least, and so do points in any other order.
    """
    count = len(values)
    if count < _FEWEST or (count % 4 == 0 and count % 3 and count % 5):
        return 4
    # a logarithm beyond 1 m, so that no single value decides
    head = np.arcsinh(np.nan_to_num(values[: min(_SEEN, count // 60 * 60)]))
    spreads = []
    for width in _WIDTHS:
        rows = head.reshape(-1, width)
        shuffled = np.random.default_rng(0).permutation(rows)
        spreads.append([float(np.abs(np.diff(own, axis=0)).mean()) for own in (rows, shuffled)])
    best = {_WIDTHS[k] for k in np.argmin(spreads, axis=0)}
    return best.pop() if len(best) == 1 else 4


def _read_npy(path: Path) -> tuple[Points, Times]:
    # mapped, because mapping refuses a header that claims more than the file holds, and pickled objects
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names and set(XYZ) <= set(array.dtype.names):
        name = time_field(array.dtype.names)
        points = np.stack([array[axis].ravel() for axis in XYZ], axis=1)
        return points, None if name is None else np.array(array[name]).ravel()
    if array.ndim not in (2, 3) or array.shape[-1] < 3 or array.dtype.kind != "f":
        raise UnreadableScanError(
            f"shape {array.shape}, type {array.dtype}; (N, 3 or more) or (H, W, 3 or more) floats, or fields x, y, z "
            "needed"
        )
    return np.array(array[..., :3]).reshape(-1, 3), None


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
    with open(path, "rb") as file:
        rows = _pcd_rows(file)
        names = rows.get("FIELDS") or rows.get("COLUMNS", [])  # before version 0.7
        (encoding,) = _pcd_row(rows, "DATA", 1)
        loose, width = encoding == "ascii", len(names)
        sizes, types, counts = (_pcd_row(rows, name, width, loose) for name in ("SIZE", "TYPE", "COUNT"))
        shape = ("POINTS",) if "POINTS" in rows else ("WIDTH", "HEIGHT")
        points = math.prod(int(_pcd_row(rows, name, 1)[0]) for name in shape)
        repeats = list(map(int, counts))
        if sum(repeats) > LONGEST_RECORD:
            raise UnreadableScanError(f"its header claims {sum(repeats)} values a point")
        kinds = [np.dtype(f"<{kind.replace('d', 'f')}{size}") for kind, size in zip(types, sizes, strict=True)]
        single = {name: k for k, name in reversed([*enumerate(names)]) if repeats[k] == 1}
        time = time_field([*reversed(single)])
        if not set(XYZ) <= set(single):
            raise UnreadableScanError("its header has no line FIELDS with x, y, z")
        wanted = [single[name] for name in (*XYZ, time) if name is not None]
        if not points:
            return np.empty((0, 3)), None
        if encoding == "ascii":
            table = _pcd_ascii(file, points, [sum(repeats[:k]) for k in wanted])
            return table[:, :3], None if time is None else table[:, 3]
        *starts, step = [0, *accumulate(kind.itemsize * n for kind, n in zip(kinds, repeats, strict=True))]
        packed = encoding != "binary"
        data = _pcd_data(file, points * step, packed)
        # packed, it holds field after field, else point after point
        columns: list[NDArray[Any]] = [
            np.ndarray((points,), kinds[k], data, starts[k] * (points if packed else 1),
                       (kinds[k].itemsize if packed else step,))
            for k in wanted
        ]  # fmt: skip
        return np.stack(columns[:3], axis=1), None if time is None else columns[3].copy()


def _pcd_rows(file: BinaryIO) -> dict[str, list[str]]:
    """The words of the header's lines, to DATA, by their first word."""
    rows: dict[str, list[str]] = {}
    for _ in range(100):
        name, *words = file.readline(LONGEST_LINE).decode(errors="replace").split() or [""]
        rows.setdefault(name.upper(), words)
        if name.upper() == "DATA":
            return rows
    raise UnreadableScanError("no PCD header")


def _pcd_row(rows: dict[str, list[str]], name: str, count: int, loose: bool = False) -> list[str]:
    """The words of a line of the header, or PCL's defaults without it; if `loose`, also for those that it lacks."""
    default, form, what = _PCD_ROWS[name]
    words = rows.get(name, [default] * count)
    words = [*words, *[default] * count][:count] if loose else words
    if len(words) != count or not all(re.fullmatch(form, word, re.IGNORECASE) for word in words):
        raise UnreadableScanError(f"its header line '{' '.join([name, *words]).strip()[:80]}' must have {count} {what}")
    return [word.lower() for word in words]


def _pcd_ascii(file: BinaryIO, count: int, columns: list[int]) -> Points:
    if count * 2 * len(columns) > _bytes_left(file) + 1:
        raise UnreadableScanError(f"cut off: its header claims {count} points")
    points = np.loadtxt(file, usecols=columns, ndmin=2, comments=None)
    if len(points) != count:
        raise UnreadableScanError(f"cut off: its header claims {count} points, {len(points)} are there")
    return points


def _pcd_data(file: BinaryIO, claimed: int, packed: bool) -> bytes:
    there = _bytes_left(file)
    if not packed:
        if claimed > there:
            raise UnreadableScanError(f"cut off: its header claims {claimed} bytes of points, {there} are there")
        return file.read(claimed)
    size, unpacked = struct.unpack("<II", file.read(8))
    if size > there - 8 or unpacked != claimed or unpacked > LZF_BEST_RATIO * size:
        raise UnreadableScanError(f"its header claims {claimed} bytes of points, packed into {there - 8}")
    return bytes(lzf.decompress(file.read(size), unpacked))


def _bytes_left(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size - file.tell()


def _read_las(path: Path) -> tuple[Points, Times]:
    from data.scans.surveyed import read_las

    return read_las(path)


READERS: dict[str, Callable[[Path], tuple[Points, Times]]] = {
    ".bin": _read_bin,
    ".las": _read_las,
    ".laz": _read_las,
    ".npy": _read_npy,
    ".pcd": _read_pcd,
    ".ply": _read_ply,
}
