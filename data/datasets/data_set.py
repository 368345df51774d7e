"""A data set of recordings: which of them are in its folder, whether their files are whole, and how one is opened."""

import re
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from data.bags import is_bag
from data.common.errors import UnreadableScanError, UserError
from data.scans.formats import is_scan, read_points
from data.scans.scan import ScanSource
from data.scans.sources import open_scans
from data.trajectory import Trajectory

BLOCK = 4096  # bytes at the beginning or the end of a file, in which its header or its last line is
LISTS = ("sequences.yaml", "sequence.yaml")  # the second one is what `python -m data.datasets` writes


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording that is ready to run.

    `plan` is the building's file or mesh, None where there is none, and `storey` the one on which it begins, if that is
    stated. `truth` has the poses T_bim_sensor; without a plan the positions of a point of the carrier, in any frame,
    and `point` (3,) is that point in the sensor's frame (m).
    """

    scans: ScanSource
    truth: Trajectory
    plan: Path | None = None
    storey: str | None = None
    point: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))


class DataSet(ABC):
    """A data set in a folder. Its methods raise UserError with what is missing and what to download.

    A folder is taken for this data set, complete or not, by the patterns of files `signs`.
    """

    name: ClassVar[str]
    signs: ClassVar[tuple[str, ...]]
    has_plan: ClassVar[bool] = True

    def __init__(self, folder: Path, topic: str | None = None) -> None:
        """`topic` is that of the scans in a bag, None for the data set's own or the only one."""
        self.folder, self.topic = folder, topic

    @abstractmethod
    def sequences(self) -> list[str]:
        """The names of its recordings, at least one."""

    @abstractmethod
    def check(self, sequence: str) -> None:
        """Checks that all files of a recording are there and are not cut off; reads no points."""

    @abstractmethod
    def open(self, sequence: str, work: Path) -> Recording:
        """Opens a recording; intermediate files go to `work`."""

    def building(self, sequence: str) -> str:
        """The building in which it was recorded."""
        return self.name


def check_whole(paths: Iterable[Path], advice: str) -> None:
    """Raises UserError, with `advice`, for the first file or folder of scans that is missing, empty or cut off.

    That is seen of IFC files, of bags of ROS 1, and of the smallest scan of a folder, which is read.
    """
    for path in paths:
        if (reason := _defect(path)) is not None:
            raise UserError(f"{path}: {reason}; {advice}")


def _defect(path: Path) -> str | None:
    if path.is_dir():
        return None if is_bag(path) else _defect_of_scans(path)
    size = path.stat().st_size if path.is_file() else None
    if not size:
        return "is missing" if size is None else "is empty"
    with path.open("rb") as file:
        head = file.read(BLOCK)
        file.seek(max(0, size - BLOCK))
        tail = file.read()
    if path.suffix.lower() == ".ifc" and b"END-ISO-10303-21" not in tail:
        return "is cut off: it does not end as an IFC file does"
    index = re.search(rb"^#ROSBAG V2.*index_pos=(.{8})", head, re.DOTALL)
    least = struct.unpack("<Q", index[1])[0] if index else 0
    return f"is cut off: {size} of more than {least} bytes" if size <= least else None


def _defect_of_scans(folder: Path) -> str | None:
    scans = list(filter(is_scan, folder.iterdir()))
    if not scans:
        return "no scans in it"
    smallest = min(scans, key=lambda path: path.stat().st_size)
    try:
        read_points(smallest)
    except UnreadableScanError as error:
        return f"{smallest.name}: {error}"
    return None


class Entry(BaseModel):
    """An entry of the list; relative paths are from its folder.

    `bim` is the building's file or mesh, `scans` a folder or a file, `truth` has the poses of the sensor in the
    building's frame (TUM format); `storey` is the one on which the recording begins, if it is stated.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: Path
    scans: Path
    truth: Path
    storey: str | None = None


class Listed(DataSet):
    """A folder with `sequences.yaml`, whose entries are those of `Entry`."""

    name = "own recordings"
    signs = LISTS

    def sequences(self) -> list[str]:
        return list(self._entries())

    def check(self, sequence: str) -> None:
        entry = self._entries()[sequence]
        advice = f"correct the paths of '{sequence}' in {self._list()}, or copy the file again"
        check_whole([self.folder / path for path in (entry.bim, entry.truth, entry.scans)], advice)

    def open(self, sequence: str, work: Path) -> Recording:
        """Scans of every form that `sgslam.run` takes as a file or a folder."""
        entry = self._entries()[sequence]
        scans, truth = open_scans(self.folder / entry.scans, self.topic), self.folder / entry.truth
        return Recording(scans, Trajectory.read_tum(truth), self.folder / entry.bim, entry.storey)

    def building(self, sequence: str) -> str:
        return str(self._entries()[sequence].bim)

    def _list(self) -> Path:
        return next(self.folder / name for name in LISTS if (self.folder / name).is_file())

    def _entries(self) -> dict[str, Entry]:
        """The entries by name. Raises UserError for missing, unknown or repeated ones."""
        path = self._list()
        try:
            found = TypeAdapter(list[Entry]).validate_python(yaml.safe_load(path.read_text()))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise UserError(f"{path}: cannot read this file ({type(error).__name__}); give a YAML list") from None
        except ValidationError as error:
            where, what = error.errors()[0]["loc"], error.errors()[0]["msg"]
            raise UserError(f"{path}: {'.'.join(map(str, where)) or 'list'}: {what}") from None
        entries = {entry.name: entry for entry in found}
        if not entries or len(entries) != len(found):
            raise UserError(f"{path}: must list sequences, each with a name of its own")
        return entries
