"""What the report tells of each scan: whether its place is known, and how well."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class ScanStates:
    """Of N scans, in the order of their stamps.

    `seconds` (N,) are those since the run's first scan. `lost` (N,): the scan did not fit the map, and its pose is
    predicted. `part` (N,): 0 for the map, else the number of a part that was not placed in it and is laid at the last
    known pose. `sigma` (N, 2): standard deviations (m) along x and y of the frame of the trajectory; NaN where they are
    unknown.
    """

    seconds: NDArray[np.float64]
    lost: NDArray[np.bool_]
    part: NDArray[np.int64]
    sigma: NDArray[np.float64]

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether the scan is neither lost nor in a part that was not placed."""
        return ~self.lost & (self.part == 0)

    def only(self, chosen: NDArray[np.bool_]) -> "ScanStates":
        """The chosen (N,) scans."""
        return ScanStates(self.seconds[chosen], self.lost[chosen], self.part[chosen], self.sigma[chosen])
