"""What the process that tracks and the one that maps send each other."""

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # the process that maps is started before this is loaded
    from sgslam.cli.job.scan_inputs import ScanInputs

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
class MapState:
    """The state of the map after so many `scans`; the names are those of `Answer`. `anchors` None: as before.
    `checkpoint_s` is how long the last checkpoint took. `failed` says why no more scans are added.
    `place` is the probability of the best place in the plan, and that of the runner-up."""

    scans: int = 0
    part: int = 0
    T_map_odom: Floats = field(default_factory=lambda: np.eye(4))
    T_bim_map: Floats | None = None
    anchors: tuple[HeldAnchor, ...] | None = ()
    map_stamp_ns: int | None = None
    keyframes: int = 0
    checkpoint_s: float = 0.0
    failed: str | None = None
    place: tuple[float, float] = (0.0, 0.0)
