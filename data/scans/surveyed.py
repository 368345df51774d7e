"""Formats of surveys, which need the extra `scans`: E57 files (ASTM E2807), which hold many scans, and LAS and LAZ, one
scan each (ASPRS LAS 1.4 R15)."""

import struct
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UnreadableScanError, UserError, refusing, required
from data.geometry.poses import xyzquat_to_poses
from data.scans.point_times import time_field
from data.scans.scan import Scan, ScanSource, finished
from data.trajectory.stamps import NOTE_INDICES, NS, SCAN_PERIOD_NS

_GPS_EPOCH = 315_964_800  # s: 1980-01-06 since 1970
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
BEST_RATIO = 200  # bytes that LAZ and E57 make of one


class E57Scans(ScanSource):
    """The scans of an E57 file, each in its scanner's frame. If all have poses, these serve as odometry."""

    def __init__(self, path: Path | str) -> None:
        """Reads the file's list of scans. Raises UserError if it cannot be read, is empty, or pye57 is missing."""
        super().__init__()
        self.path = Path(path)
        with refusing(f"{self.path}: a broken E57 file", "export it again"):
            self._file = _opened(self.path)
            heads = [self._file.get_header(k) for k in range(self._file.scan_count)]
            begins = [_begin(head) for head in heads]
            poses = [_pose(head) for head in heads]
        if not heads:
            raise UserError(f"{self.path}: contains no scans; give an E57 file with scans")
        known = [begin for begin in begins if begin is not None]
        timed = len(known) == len(heads) and all(a < b for a, b in pairwise(known))
        self.note = None if timed else NOTE_INDICES
        stamps = known if timed else [k * SCAN_PERIOD_NS for k in range(len(heads))]
        self.stamps_ns = np.array(stamps, dtype=np.int64)
        given = [pose for pose in poses if pose is not None]
        apart = len(given) == len(heads) and len({pose.tobytes() for pose in given}) == len(given)
        self._poses: list[NDArray[np.float64]] | None = given if apart and len(given) > 1 else None
        self._counts = [int(head.point_count) for head in heads]

    def __len__(self) -> int:
        """The number of scans in the file."""
        return len(self._counts)

    def _read(self, index: int) -> Scan:
        if self._counts[index] > BEST_RATIO * self.path.stat().st_size:
            raise UnreadableScanError(f"its header claims {self._counts[index]} points")
        with refusing("a broken scan", kind=UnreadableScanError):
            points, times = self._stored(index)
        pose = None if self._poses is None else self._poses[index]
        assert self.stamps_ns is not None
        return finished(index, int(self.stamps_ns[index]), points, times, self.path, pose, self.stamped)

    def _stored(self, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Points (N, 3) and times (N,), by libE57 itself: pye57's own functions leave out the times."""
        from pye57.libe57 import SourceDestBuffer, VectorSourceDestBuffer

        head, count = self._file.get_header(index), self._counts[index]
        wanted = (*_CARTESIAN, *_SPHERICAL, *_INVALID, "timeStamp")
        raw = {name: np.empty(count) for name in wanted if name in head.point_fields}
        buffers = VectorSourceDestBuffer()
        for name, column in raw.items():
            buffers.append(SourceDestBuffer(self._file.image_file, name, column, count, True, True))
        head.points.reader(buffers).read()
        system = _CARTESIAN if _CARTESIAN[0] in raw else _SPHERICAL
        points = np.stack([raw[name] for name in system], axis=1)
        if system is _SPHERICAL:
            reach, azimuth, elevation = points.T
            level = reach * np.cos(elevation)
            points = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), reach * np.sin(elevation)], axis=1)
        for state in _INVALID:
            points[raw.get(state, 0) != 0] = np.nan
        return points, raw.get("timeStamp")


def _opened(path: Path) -> Any:
    pye57 = required("pye57", f"{path}: E57", "scans")
    if not path.is_file():
        raise UserError(f"{path}: no such file; give an E57 file")
    with path.open("rb") as file:
        head = file.read(48)
    if len(head) < 48 or head[:8] != b"ASTM-E57" or struct.unpack_from("<Q", head, 16)[0] != path.stat().st_size:
        raise UserError(f"{path}: not an E57 file, or cut off; give a complete one")
    return pye57.E57(str(path))


def _begin(head: Any) -> int | None:
    """The start time of a scan (ns since 1970); None if the file does not state it."""
    try:
        seconds = float(head["acquisitionStart"]["dateTimeValue"].value())
    except Exception:
        return None
    return round((seconds + _GPS_EPOCH) * NS) if 0 < seconds < 1e10 else None


def _pose(head: Any) -> NDArray[np.float64] | None:
    if not head.has_pose():
        return None
    w, x, y, z = (float(value) for value in head.rotation)
    values = np.array([*map(float, head.translation), x, y, z, w])
    if not np.isfinite(values).all() or abs(float(np.linalg.norm(values[3:])) - 1) > 1e-3:
        return None
    return xyzquat_to_poses(values)


def read_las(path: Path) -> tuple[NDArray[np.float64], NDArray[Any] | None]:
    """Points (N, 3) and their times (N,) as stored, those of GPS or an extra dimension. Raises UnreadableScanError, and
    UserError without laspy.
    """
    laspy = required("laspy", f"{path}: LAS", "scans")
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
