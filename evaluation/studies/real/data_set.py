"""What the study needs of a data set: its recordings, and which files of it must be there."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from data.scans.formats import READERS
from data.scans.scan import ScanSource
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording that is ready to run.

    `plan` is the A-graph, None where there is no plan. `truth` has the poses T_bim_sensor; without a plan the positions
    of a point of the carrier, in any frame, and `point` (3,) is that point in the sensor's frame (m).
    """

    scans: ScanSource
    plan: SceneGraph | None
    truth: Trajectory
    point: NDArray[np.float64]


class DataSet(ABC):
    """A data set in a folder. Its methods raise UserError with what is missing and what to download."""

    name: ClassVar[str]
    has_plan: ClassVar[bool] = True

    def __init__(self, folder: Path, topic: str | None = None) -> None:
        """`topic` is that of the scans in a bag, None for the data set's own or the only one."""
        self.folder, self.topic = folder, topic

    @staticmethod
    @abstractmethod
    def is_in(folder: Path) -> bool:
        """Whether the folder looks like this data set, complete or not."""

    @abstractmethod
    def sequences(self) -> list[str]:
        """The names of its recordings, at least one."""

    @abstractmethod
    def check(self, sequence: str) -> None:
        """Checks that all files of a recording are there and are not cut off; reads no points."""

    @abstractmethod
    def open(self, sequence: str, work: Path) -> Recording:
        """Opens a recording; intermediate files go to `work`."""


def parts_of(scans: Path) -> list[Path]:
    """The files of a recording's scans: those in a folder, or the one file that it is."""
    if not scans.is_dir():
        return [scans]
    kinds = (*READERS, ".db3", ".mcap", ".bag")
    return sorted(path for path in scans.iterdir() if path.suffix.lower() in kinds and not path.name.startswith("."))
