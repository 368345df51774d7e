"""What the process that tracks and the one that maps send each other."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scans.scan import SkippedScan
from sgslam.config import Config
from sgslam.live.answer import HeldAnchor
from sgslam.tracking import TrackerNotes
from sgslam.types import TrackedScan

Floats = NDArray[np.float64]
Pose2 = tuple[float, float, float]  # x, y (m), yaw (rad) in the BIM frame


@dataclass(frozen=True)
class LiveInputs:
    """What a live run is given beside its scans; the names are those of the options of `sgslam run`."""

    out: Path
    config: Config
    bim: Path | None = None
    layers: tuple[str, ...] = ()
    map: Path | None = None
    storey: str | None = None
    start: Pose2 | None = None
    ground_truth: Path | None = None
    verbose: bool = False


@dataclass(frozen=True, eq=False)
class TrackedMessage:
    """A tracked scan, and the tracker's notes then."""

    scan: TrackedScan
    notes: TrackerNotes


@dataclass(frozen=True)
class StartMessage:
    """Where the sensor roughly is in the building, at the scan before."""

    pose: Pose2


@dataclass(frozen=True)
class LogMessage:
    """A line for the log of the run."""

    name: str
    level: int
    text: str


@dataclass(frozen=True)
class FinishMessage:
    """No scan comes any more. `seconds` are those of tracking, `measured` goes into metrics.json."""

    seconds: float
    skipped: tuple[SkippedScan, ...]
    remarks: tuple[str, ...]
    measured: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class MapState:
    """The state of the map after so many `scans`; the names are those of `Answer`. `anchors` None: as before."""

    scans: int = 0
    part: int = 0
    T_map_odom: Floats = field(default_factory=lambda: np.eye(4))
    T_bim_map: Floats | None = None
    anchors: tuple[HeldAnchor, ...] | None = ()
    map_stamp_ns: int | None = None
    keyframes: int = 0
