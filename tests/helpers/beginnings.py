"""Where a map begins."""

import numpy as np
from numpy.typing import NDArray


def begins_here(T_map_first: NDArray[np.float64], tilt_deg: float = 1.0) -> bool:
    """Whether the first pose (4, 4) has the map's place and heading; a level sensor is `tilt_deg` off z at most."""
    heading = np.arctan2(T_map_first[1, 0], T_map_first[0, 0])
    tilt = np.degrees(np.arccos(np.clip(T_map_first[2, 2], -1, 1)))
    return bool(np.linalg.norm(T_map_first[:3, 3]) < 1e-4 and abs(heading) < 1e-3 and tilt < tilt_deg)
