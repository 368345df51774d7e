"""The points of all keyframes, stored on disk, and the point cloud map: their means in each voxel."""

import contextlib
import logging
import os
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import atomic_file

Floats = NDArray[np.float64]
FILE = "keyframe_clouds.bin"  # in a run's folder
_MAGIC = b"SGKC0001"
_SHELL = 1.5  # ratio of the distances from the sensor within which cells of directions have one width
_RECORD = struct.Struct("<II")  # keyframe, points; then so many float32 x y z
_log = logging.getLogger(__name__)
_BATCH = 1_000_000  # points merged into the map at once


class KeyframeClouds:
    """Points (N, 3) float32 of keyframes, in metres, in each keyframe's sensor frame, about `voxel` (m) apart.

    `path` is the file, which is overwritten; None for an unnamed one that is deleted with the process. Memory holds a
    few numbers for each keyframe. If the disk is full, further clouds are dropped and the run goes on.
    """

    def __init__(self, path: Path | None = None, voxel: float = 0.1) -> None:
        self.path, self.voxel = path, voxel
        opened = tempfile.TemporaryFile(buffering=0) if path is None else path.open("w+b", buffering=0)  # noqa: SIM115
        self._begin(cast(BinaryIO, opened))
        os.write(self._file.fileno(), _MAGIC)
        self._end = len(_MAGIC)

    def __getstate__(self) -> dict[str, float]:
        """Without the points: these stay where they are."""
        return {"voxel": self.voxel}

    def __setstate__(self, state: dict[str, float]) -> None:
        """Clouds without points."""
        KeyframeClouds.__init__(self, voxel=state["voxel"])

    def _begin(self, file: BinaryIO) -> None:
        self._file = file
        self._places: dict[int, tuple[int, int]] = {}  # keyframe: offset in the file, number of points
        self._full = False

    @classmethod
    def open(cls, path: Path, keyframes: int | None = None, voxel: float = 0.1) -> "KeyframeClouds":
        """Opens a file for reading and adding; an incomplete record at the end is dropped.

        With `keyframes`, clouds from that number on are dropped, for a run that resumes from there. Raises UserError
        for a missing file and for one without clouds.
        """
        self = cls.__new__(cls)
        self.path, self.voxel = path, voxel
        try:
            self._begin(cast(BinaryIO, path.open("r+b" if os.access(path, os.W_OK) else "rb", buffering=0)))
        except OSError as error:
            raise UserError(f"{path}: cannot be read ({error.strerror})") from None
        size, place = os.fstat(self._file.fileno()).st_size, len(_MAGIC)
        if self._file.read(len(_MAGIC)) != _MAGIC:
            raise UserError(f"{path}: holds no clouds of keyframes")
        while place + _RECORD.size <= size:
            keyframe, count = _RECORD.unpack(os.pread(self._file.fileno(), _RECORD.size, place))
            beyond = place + _RECORD.size + 12 * count
            if beyond > size or (keyframes is not None and keyframe >= keyframes):
                break
            self._places[keyframe] = place + _RECORD.size, count
            place = beyond
        self._end = place
        return self

    def add(self, keyframe: int, points: NDArray[np.floating]) -> None:
        """Stores the points (N, 3) of a keyframe, numbered as in the back end; see `one_a_direction`."""
        kept = points[one_a_direction(points, self.voxel)].astype("<f4")
        record = _RECORD.pack(keyframe, len(kept)) + kept.tobytes()
        try:
            os.ftruncate(self._file.fileno(), self._end)  # drops what an earlier run left beyond
            written = os.pwrite(self._file.fileno(), record, self._end)
            if written < len(record):
                raise OSError("only a part could be written")
        except OSError as error:
            if not self._full:
                _log.warning("%s: the clouds of further keyframes cannot be stored (%s)", self.path or "disk", error)
            self._full = True
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self._end)
            return
        self._places[keyframe] = self._end + _RECORD.size, len(kept)
        self._end += len(record)

    def take(self, other: "KeyframeClouds", first: int = 0) -> None:
        """Adds those of another map, whose keyframes are numbered from `first` on here."""
        for keyframe in other:
            self.add(first + keyframe, other[keyframe])

    def make_room(self) -> None:
        """Drops all clouds to free disk space for more important files."""
        self._places, self._end, self._full = {}, len(_MAGIC), True
        os.ftruncate(self._file.fileno(), self._end)

    def __getitem__(self, keyframe: int) -> NDArray[np.float32]:
        """(N, 3) the points of a keyframe in its sensor frame; (0, 3) where none are stored. Thread-safe."""
        place, count = self._places.get(keyframe, (0, 0))
        raw = os.pread(self._file.fileno(), 12 * count, place)
        return np.frombuffer(raw, "<f4").reshape(-1, 3).astype(np.float32, copy=False)

    def __iter__(self) -> Iterator[int]:
        """Iterates over the keyframes with stored points, in their order."""
        return iter(self._places)

    def __len__(self) -> int:
        """The number of keyframes with stored points."""
        return len(self._places)

    def copy_to(self, path: Path) -> None:
        """Copies all clouds to another file, atomically and in pieces; does nothing if that is the same file."""
        if self.path is not None and path.exists() and path.samefile(self.path):
            return
        with atomic_file(path) as file:
            for place in range(0, self._end, 1 << 20):
                file.write(os.pread(self._file.fileno(), min(1 << 20, self._end - place), place))


def voxel_keys(points: NDArray[np.floating], voxel: float) -> NDArray[np.int64]:
    """(N,) a key for the cube of side `voxel` that each point (N, 3) lies in.

    21 bits for each axis: a million voxels to either side of zero.
    """
    cells = np.floor(points / voxel).astype(np.int64) + (1 << 20)
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2])


def one_a_direction(points: NDArray[np.floating], spacing: float) -> NDArray[np.int64]:
    """The indices (M,), ascending, of the first of points (N, 3) in each cell of directions from the sensor, which is
    about `spacing` (m) wide where the point is.

    Cells in space would favour noise: of a surface near the border of two cells, the few points beyond it would count
    as much as all others.
    """
    away = np.maximum(np.linalg.norm(points, axis=1), 1e-3)
    shell = np.floor(np.log(away) / np.log(_SHELL)).astype(np.int64)
    width = spacing / _SHELL ** (shell + 0.5)
    ring = np.floor(np.arcsin(points[:, 2] / away) / width).astype(np.int64)
    around = np.arctan2(points[:, 1], points[:, 0]) * np.cos((ring + 0.5) * width)
    across = np.floor(around / width).astype(np.int64)
    cells = (((shell << 21) + ring) << 21) + across  # one number for all three, which are far below 20 bits
    return np.sort(np.unique(cells, return_index=True)[1])


def cloud_map(clouds: KeyframeClouds, poses: dict[int, Floats], voxel: float) -> tuple[Floats, Floats]:
    """(M, 3) the map in the frame of `poses`: (4, 4) T_frame_sensor by keyframe number; other clouds are left out.

    It is the mean of the points in each voxel, which must lie within a million voxels of the first keyframe. And (M, 3)
    unit vectors from its points towards the sensor that saw them, in the mean. Memory grows with the occupied voxels,
    not with the points.
    """
    known = [keyframe for keyframe in clouds if keyframe in poses]
    if not known:
        return np.empty((0, 3)), np.empty((0, 3))
    origin = np.floor(poses[known[0]][:3, 3])
    keys, sums = np.empty(0, np.int64), np.empty((0, 7))  # of places, of directions, and the number of points
    waiting: list[Floats] = []
    for keyframe in known:
        T = poses[keyframe]
        rays = clouds[keyframe] @ T[:3, :3].T
        towards = -rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9)
        waiting.append(np.column_stack([rays + T[:3, 3] - origin, towards, np.ones(len(rays))]))
        if sum(map(len, waiting)) >= _BATCH or keyframe == known[-1]:
            added = np.concatenate(waiting)
            keys = np.concatenate([keys, voxel_keys(added[:, :3], voxel)])
            keys, place = np.unique(keys, return_inverse=True)
            rows = np.concatenate([sums, added])
            sums, waiting = np.stack([np.bincount(place, column, len(keys)) for column in rows.T], axis=1), []
    means = sums[:, :6] / sums[:, 6:]
    towards = means[:, 3:]
    return means[:, :3] + origin, towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
