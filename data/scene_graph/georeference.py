"""Where a plan lies on the map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Georeference:
    """The map coordinates (m) of the origin of the BIM frame in the reference system `crs`, such as `EPSG:25832`.

    `rotation` (rad) leads from the map's east to the plan's x axis, `true_north` from the plan's y axis to the north
    pole, both counter-clockwise. `scale` is the length on the map of a metre of the building.
    """

    crs: str
    easting: float
    northing: float
    height: float
    rotation: float = 0.0
    scale: float = 1.0
    true_north: float = 0.0

    @property
    def _origin(self) -> Floats:
        return np.array([self.easting, self.northing, self.height])

    @property
    def _turn(self) -> Floats:
        c, s = np.cos(self.rotation), np.sin(self.rotation)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def on_map(self, points: Floats) -> Floats:
        """(N, 3) easting, northing and height of points (N, 3) in the BIM frame."""
        return np.asarray(self.scale * points @ self._turn.T + self._origin)

    def in_plan(self, points: Floats) -> Floats:
        """(N, 3) points in the BIM frame, given by their map coordinates (N, 3)."""
        return np.asarray((points - self._origin) @ self._turn / self.scale)

    def poses_on_map(self, poses: Floats) -> Floats:
        """(N, 4, 4) poses in the BIM frame with positions and axes on the map."""
        moved = np.array(poses)
        moved[:, :3, :3], moved[:, :3, 3] = self._turn @ poses[:, :3, :3], self.on_map(poses[:, :3, 3])
        return moved

    def __str__(self) -> str:
        """One line for people."""
        origin = f"E {self.easting:.3f} m, N {self.northing:.3f} m, height {self.height:.3f} m"
        return f"{self.crs}: origin of the plan at {origin}; its x axis {np.degrees(self.rotation):.4f}° from east"
