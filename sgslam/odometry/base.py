"""Odometry behind one interface: a scan goes in, T_odom_sensor comes out.

An odometry from outside needs no such object: see `sgslam.odometry.external` and `SceneGraphSlam.add_scan`.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
State = Mapping[str, Floats]  # arrays by name, as np.savez takes them


class Odometry(Protocol):
    """Anything that tracks the sensor from scan to scan."""

    @property
    def upright_only(self) -> bool:
        """Whether it is to be given only the points on upright surfaces, as the scan itself tells them."""
        ...

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """Takes (N, 3) points of one scan in the sensor frame, N >= 0; returns (4, 4) T_odom_sensor.

        `expected_step` (4, 4) is T_last_sensor as somebody who knows more expects it, as a start of the search.
        """
        ...

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """Takes over a step (4, 4) that somebody who knows more has found; returns T_odom_sensor. `points` gives what
        `register` would have been given."""
        ...

    def state(self) -> dict[str, Floats]:
        """All that it knows, as arrays: another one of the same settings that `restore`s it goes on alike, bit by
        bit."""
        ...

    def restore(self, state: State) -> None:
        """Takes over what `state` gave."""
        ...
