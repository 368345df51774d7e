"""The protocol of the estimates that the map takes from the factor graph."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping.keyframes import KeyframeNode

Floats = NDArray[np.float64]


class Estimates(Protocol):
    """Estimates in the map frame; `Backend` is one."""

    @property
    def keyframes(self) -> list[KeyframeNode]:
        """In the order in which they were taken."""
        ...

    @property
    def poses(self) -> Floats:
        """(K, 4, 4) T_map_sensor of all keyframes."""
        ...

    @property
    def planes_in_map(self) -> dict[int, Floats]:
        """The plane (4,) of each wall by its number."""
        ...

    @property
    def levels_in_map(self) -> dict[int, Floats]:
        """The plane (4,) of each level surface by its number."""
        ...
