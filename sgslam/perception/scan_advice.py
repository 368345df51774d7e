"""What is probably wrong with scans that are no scans of a building's inside, in metres, in the sensor's frame."""

import numpy as np
from numpy.typing import NDArray

_FARTHEST = 200.0  # m, median range indoors and out of doors; in millimetres that is a narrow corridor
_OUTSIDE = 10.0  # times the extent of a scan: a sensor so far from all that it sees is not at the origin


def scan_advice(points: NDArray[np.float64]) -> str | None:
    """One line about a scan (N, 3) that seems to be in another frame or unit, None for any other."""
    middle = np.median(points, axis=0)
    distance = float(np.linalg.norm(middle))
    extent = float(np.median(np.linalg.norm(points - middle, axis=1)))
    if distance > _OUTSIDE * extent:
        return (
            f"the first scan lies {distance:.0f} m from the origin and is {2 * extent:.0f} m wide: the scans seem to "
            "be in one world frame; give each in its own sensor frame"
        )
    far = float(np.median(np.linalg.norm(points, axis=1)))
    if far > _FARTHEST:
        return f"the median range is {far:.0f} m: the scans seem to be in millimetres; divide them by 1000"
    return None
