"""Refuses stamps in another unit than the one expected, recognised by the time between scans."""

from collections.abc import Sequence

import numpy as np

from data.common.errors import UserError
from data.trajectory.stamps import NS

_FEWEST = 4  # scans: of fewer, a single odd stamp would decide
_SHORTEST, _LONGEST = 0.02, 0.5  # s between the scans of a moving LiDAR
_FASTEST, _SLOWEST = 1e-3, 1e4  # s between any scans: none are faster, nor hours apart
_EVEN = 0.2  # of the median, within which the middle half of a LiDAR's intervals lies; stations are set up less evenly


def check_interval(stamps_ns: Sequence[int], where: str) -> None:
    """Raises UserError if the stamps of scans seem to be in another unit, and names it. `where` says what holds them.

    Scans that are minutes apart are accepted if they are so unevenly: they may be a survey's.
    """
    if len(stamps_ns) < _FEWEST:
        return
    low, interval, high = np.percentile(np.diff(np.array(stamps_ns, dtype=np.float64)) / NS, [25, 50, 75]).tolist()
    if interval <= 0:  # stamps that do not increase are judged elsewhere
        return
    unit = None
    if interval > _SLOWEST:  # taken for seconds
        unit = "microseconds" if interval < _LONGEST * 1e6 else "nanoseconds"
    elif interval < _FASTEST:  # taken for nanoseconds
        unit = "microseconds" if interval > _SHORTEST * 1e-3 else "milliseconds"
    elif _SHORTEST * 1e3 <= interval <= _LONGEST * 1e3 and high - low <= _EVEN * interval:
        unit = "milliseconds"
    if unit is not None:
        raise UserError(
            f"{where}: the scans are {interval:.3g} s apart by their stamps, which seem to be in {unit}; give seconds "
            "in times.txt, in names seconds with a decimal point or nanoseconds"
        )
