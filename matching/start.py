"""A rough start pose given by the user, and which placements are near it."""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array

START_M, START_RAD = 3.0, np.radians(60)
Start = tuple[float, float, float]  # (yaw, x, y) of the map's origin in the BIM frame, as T_a_s: radians and metres


def near_start(start: Start, T_a_s: Array) -> bool:
    """Whether a placement is at most 3 m and 60 degrees from the start."""
    turn = abs(se2.wrap(T_a_s[:1] - start[0])[0])
    return bool(np.hypot(T_a_s[1] - start[1], T_a_s[2] - start[2]) <= START_M and turn <= START_RAD)
