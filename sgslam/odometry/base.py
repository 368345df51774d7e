"""The protocol of an odometry: it takes a scan and returns where it was taken, in a frame that never jumps.

Poses that an external odometry gives do not need it: see `sgslam.odometry.given`.
"""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sgslam.registration import Registration

Floats = NDArray[np.float64]
State = Mapping[str, Any]


class Odometry(Protocol):
    """Anything that tracks the sensor from scan to scan. The frame `odom` is the frame of its first pose.

    The stamps increase. Where the sensor was carried elsewhere, a run restores the state from before the first scan,
    and registers the scans since then again: another frame `odom` begins. One without a state goes on instead.
    """

    @property
    def residual(self) -> float:
        """The mean distance of the newest scans' points from the local map, in a unit that the odometry chooses;
        infinite if unknown."""
        ...

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """Registers the points (N, 3), N >= 0, of one scan in the sensor frame, measured `point_times` (N,) seconds
        after its stamp (None if unknown)."""
        ...

    def level(self, up_in_odom: Floats) -> None:
        """Sets the direction of gravity (3,) in `odom`, once it is known."""
        ...

    def look_back(self, results: list[Registration]) -> list[Registration]:
        """Returns the results of all scans so far, with the first ones registered again, as these had hardly any map
        before. To be called once, after some seconds."""
        ...

    def rejoin(self, other: "Odometry") -> bool:
        """Tries to register the scan that `other` registered last near the place where the sensor was lost, and
        continues from there. Returns whether it fits."""
        ...

    def state(self) -> dict[str, Any]:
        """Returns the state as a tree; another instance with the same settings continues identically."""
        ...

    def restore(self, state: State) -> None:
        """Restores what `state` returned; nothing remains of scans that were registered since."""
        ...
