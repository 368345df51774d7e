"""LAS and LAZ files, one scan each (ASPRS LAS 1.4 R15). Needs the extra `scans`."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scans.point_times import time_field
from data.scans.reading_errors import MissingReaderError, UnreadableScanError

BEST_RATIO = 200  # bytes that LAZ and E57 make of one

INSTALL = "pip install 'sgslam[scans]'"


def read_las(path: Path) -> tuple[NDArray[np.float64], NDArray[Any] | None]:
    """Points (N, 3) and their times (N,) as stored, those of GPS or an extra dimension. Raises UnreadableScanError,
    MissingReaderError.
    """
    try:
        import laspy
    except ModuleNotFoundError:
        raise MissingReaderError(f"{path}: LAS needs laspy: {INSTALL}") from None
    _check_las(path)
    try:
        # by one thread: a panic in another one ends the process
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as file:
            header = file.header
            claimed, there = header.point_count * header.point_format.size, path.stat().st_size
            if claimed > (BEST_RATIO if header.are_points_compressed else 1) * there:
                raise UnreadableScanError(f"cut off: its header claims {header.point_count} points")
            points = file.read()
    except (Exception, UnreadableScanError):
        raise
    except BaseException as error:  # a panic of lazrs, which is no Exception
        if type(error).__name__ != "PanicException":
            raise
        raise UnreadableScanError("its compressed points are damaged") from None
    if len(points) != header.point_count:
        raise UnreadableScanError(f"cut off: its header claims {header.point_count} points, {len(points)} are there")
    name = time_field(list(points.point_format.dimension_names))
    return np.stack([points.x, points.y, points.z], axis=1), None if name is None else np.asarray(points[name])


def _check_las(path: Path) -> None:
    """What the header claims of records before and after the points, before anything loops over them."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
    if not head.startswith(b"LASF") or len(head) < 227:
        raise UnreadableScanError("no LAS header")
    head_size, start, records = struct.unpack_from("<HII", head, 94)
    later, later_records = struct.unpack_from("<QI", head, 235) if head[25] >= 4 and len(head) >= 247 else (0, 0)
    if head_size < 227 or start > size or records * 54 > size or later > size or later_records * 60 > size:
        raise UnreadableScanError("its header claims more than the file holds")
    if head[104] & 0x80:  # LAZ: a table of its chunks lies where the points begin with a pointer to it
        with path.open("rb") as file:
            file.seek(start)
            (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
            file.seek(*((table, 0) if 0 < table < size - 8 else (size - 8, 0)))
            _, chunks = struct.unpack("<II", file.read(8).ljust(8, b"\0"))
        if not 0 < table < size - 8 or chunks > size:
            raise UnreadableScanError("cut off: the table of its compressed points is not there")
