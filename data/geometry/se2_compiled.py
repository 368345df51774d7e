"""What `data.geometry.se2` offers, for compiled loops: of single numbers."""

import numpy as np

from data.common.compiled import compiled


@compiled
def wrapped(angle: float) -> float:
    """An angle to [-pi, pi)."""
    return float(angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi)))
