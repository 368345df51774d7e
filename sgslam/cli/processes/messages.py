"""What the process that tracks and the one that maps send each other."""

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from data.scans.scan import SkippedScan

if TYPE_CHECKING:  # the process that maps is started before these are loaded
    from sgslam.cli.job.scan_inputs import ScanInputs
    from sgslam.tracking import TrackerNotes, TrackingStep

Floats = NDArray[np.float64]
Pose2 = tuple[float, float, float]  # x, y (m), yaw (rad) in the BIM frame


@dataclass(frozen=True)
class HeldAnchor:
    """An anchor that holds: the wall `wall` of the S-graph, the surface `a_id` of the plan, and how tightly."""

    wall: str
    a_id: str
    state: Literal["tight", "loose"]


@dataclass(frozen=True, eq=False)
class MapInputs:
    """What the process that maps begins with: the `options` of `sgslam run`, and what is known of the scans that the
    other process reads. `prepare` is called first.

    Where the process that tracks is gone, a live run's results are written (`outlives`); another run is resumed.
    """

    options: Namespace
    scans: "ScanInputs"
    prepare: Callable[[], None] | None = None
    outlives: bool = False


@dataclass(frozen=True, eq=False)
class TrackedMessage:
    """A step of the tracker, and its notes then."""

    step: "TrackingStep"
    notes: "TrackerNotes"


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


@dataclass(frozen=True, eq=False)
class CheckpointMessage:
    """The states of the tracker and of `Progress` after the steps so far, to be written with that of the map."""

    tracking: dict[str, Any]
    progress: dict[str, Any]


@dataclass(frozen=True)
class FinishMessage:
    """No scan comes any more, for the reason `stopped` where it is not the last one.

    `seconds` are those of tracking, `cpu_seconds` those of all that the process did; `measured` goes into metrics.json.
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    skipped: tuple[SkippedScan, ...] = ()
    remarks: tuple[str, ...] = ()
    stopped: str | None = None
    progress: dict[str, Any] = field(default_factory=dict)
    measured: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class MapState:
    """The state of the map after `steps` steps; the names are those of `Answer`. `anchors` None: as before.
    `checkpoint_s` is how long the last checkpoint took."""

    steps: int = 0
    part: int = 0
    T_map_odom: Floats = field(default_factory=lambda: np.eye(4))
    T_bim_map: Floats | None = None
    anchors: tuple[HeldAnchor, ...] | None = ()
    map_stamp_ns: int | None = None
    keyframes: int = 0
    checkpoint_s: float = 0.0
