"""Upright boxes as triangles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
SPOT = 0.025  # m between the points of a footprint: half a cell of the storey's grid


@dataclass(frozen=True, eq=False)
class UprightBox:
    """A box on the rectangle about `centre` (2,) with the half `sides` (2, 2), from z `low` to `high`; metres."""

    centre: Array
    sides: Array
    low: float
    high: float

    @property
    def triangles(self) -> Array:
        """(12, 3, 3)."""
        xy = self.centre + (2 * _CORNERS[:, :2] - 1) @ self.sides
        corners = np.column_stack([xy, self.low + (self.high - self.low) * _CORNERS[:, 2]])
        quads = corners[_FACES]
        return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])

    @property
    def footprint(self) -> Array:
        """(N, 2) points all over the rectangle, at most SPOT apart."""
        counts = np.ceil(2 * np.linalg.norm(self.sides, axis=1) / SPOT).astype(int) + 1
        u, v = np.meshgrid(*(np.linspace(-1, 1, count) for count in counts))
        return np.asarray(self.centre + np.column_stack([u.ravel(), v.ravel()]) @ self.sides)
