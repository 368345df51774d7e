"""The keyframes' points, kept on the disk: an hour's run must not fill the memory with what is needed only now and
then (loop closures, the point cloud map at the end)."""

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

FILE = "keyframe_clouds.bin"  # in a run's folder
_MAGIC = b"SGKC0001"
_RECORD = struct.Struct("<II")  # keyframe, points; then so many float32 x y z
_log = logging.getLogger(__name__)


class KeyframeClouds:
    """Points (N, 3) float32 of keyframes, metres, each in its keyframe's sensor frame, one point for each `voxel`.

    `path` is the file that they are kept in (made anew), None for a nameless one that goes with the process. What is in
    memory is a few numbers a keyframe. A disk that is full costs clouds, not the run.
    """

    def __init__(self, path: Path | None = None, voxel: float = 0.1) -> None:
        self.path, self.voxel = path, voxel
        opened = tempfile.TemporaryFile(buffering=0) if path is None else path.open("w+b", buffering=0)  # noqa: SIM115
        self._begin(cast(BinaryIO, opened))
        os.write(self._file.fileno(), _MAGIC)
        self._end = len(_MAGIC)

    def _begin(self, file: BinaryIO) -> None:
        self._file = file
        self._places: dict[int, tuple[int, int]] = {}  # keyframe: place in the file, number of points
        self._full = False

    @classmethod
    def open(cls, path: Path, keyframes: int | None = None, voxel: float = 0.1) -> "KeyframeClouds":
        """Those of a file, to read and to add to; a record that breaks off at the end is cut off.

        With `keyframes` all that come at or after that number are forgotten, for a run that goes on from there.
        Raises UserError for a file that is missing or is none of clouds.
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
        """Keeps the points (N, 3) of a keyframe, numbered as the back end's; at most one for each voxel."""
        kept = points[one_a_voxel(points, self.voxel)].astype("<f4")
        record = _RECORD.pack(keyframe, len(kept)) + kept.tobytes()
        try:
            os.ftruncate(self._file.fileno(), self._end)  # what a run before this one left beyond is forgotten
            written = os.pwrite(self._file.fileno(), record, self._end)
            if written < len(record):
                raise OSError("only a part could be written")
        except OSError as error:
            if not self._full:
                _log.warning("%s: clouds of keyframes cannot be kept from here on (%s)", self.path or "disk", error)
            self._full = True
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self._end)
            return
        self._places[keyframe] = self._end + _RECORD.size, len(kept)
        self._end += len(record)

    def give_way(self) -> None:
        """Forgets all clouds and frees their room on the disk, for what matters more."""
        self._places, self._end, self._full = {}, len(_MAGIC), True
        os.ftruncate(self._file.fileno(), self._end)

    def __getitem__(self, keyframe: int) -> NDArray[np.float32]:
        """(N, 3) the points of a keyframe, its sensor's frame; none (0, 3) where none were kept. Safe from any
        thread."""
        place, count = self._places.get(keyframe, (0, 0))
        raw = os.pread(self._file.fileno(), 12 * count, place)
        return np.frombuffer(raw, "<f4").reshape(-1, 3).astype(np.float32, copy=False)

    def __iter__(self) -> Iterator[int]:
        """The keyframes whose points were kept, in their order."""
        return iter(self._places)

    def __len__(self) -> int:
        """How many keyframes' points were kept."""
        return len(self._places)

    def copy_to(self, path: Path) -> None:
        """Writes them to another file, atomically, a piece at a time; nothing where that is their own file."""
        if self.path is not None and path.exists() and path.samefile(self.path):
            return
        with atomic_file(path) as file:
            for place in range(0, self._end, 1 << 20):
                file.write(os.pread(self._file.fileno(), min(1 << 20, self._end - place), place))


def voxel_keys(points: NDArray[np.floating], voxel: float) -> NDArray[np.int64]:
    """(N,) one number for each cube of side `voxel` that points (N, 3) lie in: 21 bits an axis, a million voxels to
    either side of zero."""
    cells = np.floor(points / voxel).astype(np.int64) + (1 << 20)
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2])


def one_a_voxel(points: NDArray[np.floating], voxel: float) -> NDArray[np.int64]:
    """The places of points (N, 3) of which each is the first in its voxel, in the points' order."""
    return np.sort(np.unique(voxel_keys(points, voxel), return_index=True)[1])
