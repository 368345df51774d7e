"""The protocol of an odometry: it takes a scan and returns T_odom_sensor.

An external odometry does not need it: see `sgslam.odometry.external` and `SceneGraphSlam.add_scan`.
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
        """Whether it uses only points on upright surfaces."""
        ...

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """Registers points (N, 3), N >= 0, of one scan in the sensor frame; returns T_odom_sensor (4, 4).

        `expected_step` (4, 4), T_last_sensor, is the caller's prediction, from which the registration starts.
        """
        ...

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """Adopts a step T_last_sensor (4, 4) that the caller found; returns T_odom_sensor (4, 4).

        `points` returns the points that `register` would take.
        """
        ...

    def state(self) -> dict[str, Floats]:
        """Returns the state as arrays; another instance of the same settings continues from it bit by bit."""
        ...

    def restore(self, state: State) -> None:
        """Restores what `state` returned."""
        ...
