"""The free space of rooms as a raster: what a map and a plan say about each other where neither has a wall.

A map of equal offices fits at several places, but where it ends, walls of the plan stand in what the map saw as free.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array

if TYPE_CHECKING:
    from matching.arrays.walls import Walls

Index = NDArray[np.int64]
STEP_M = 0.2  # of the raster
INSIDE_M = 0.3  # from a room's outline on a wall is in conflict with its free space: a wall's thickness, and drift


@dataclass(frozen=True)
class FreeSpace:
    """Cells of rooms with an outline, in the own frame of their walls.

    `room` (H, W) is the room of each cell, -1 where there is none; `inside` (H, W) are cells away from the outlines;
    `origin` (2,) is the lower corner.
    """

    room: Index
    inside: NDArray[np.bool_]
    origin: Array

    @staticmethod
    def of(walls: "Walls") -> "FreeSpace":
        """The free space of the rooms of walls."""
        T = se2.inverse(walls.T_graph_own)
        outlines = [
            (n, shapely.Polygon(se2.apply(T, np.array(room.polygon))).buffer(0))
            for n, room in enumerate(walls.rooms)
            if room.polygon is not None and len(room.polygon) > 2
        ]
        bounds = np.array([area.bounds for _, area in outlines if not area.is_empty]).reshape(-1, 4)
        low = bounds[:, :2].min(axis=0, initial=np.inf)
        if not len(bounds):
            return FreeSpace(np.full((1, 1), -1), np.zeros((1, 1), dtype=np.bool_), np.zeros(2))
        size = np.ceil((bounds[:, 2:].max(axis=0) - low) / STEP_M).astype(int)
        room, inside = np.full(size, -1), np.zeros(size, dtype=np.bool_)
        for n, area in outlines:
            if area.is_empty:
                continue
            x0, y0, x1, y1 = (int((v - low[k % 2]) / STEP_M) for k, v in enumerate(area.bounds))
            x, y = np.meshgrid(np.arange(x0, x1 + 1), np.arange(y0, y1 + 1), indexing="ij")
            x, y = np.minimum(x.ravel(), size[0] - 1), np.minimum(y.ravel(), size[1] - 1)
            place = low + (np.stack((x, y), axis=1) + 0.5) * STEP_M
            own = shapely.contains_xy(area, place)
            room[x[own], y[own]] = n
            away = shapely.contains_xy(area.buffer(-INSIDE_M), place)
            inside[x[away], y[away]] = True
        return FreeSpace(room, inside, low)

    @property
    def centres(self) -> tuple[Array, Index]:
        """(P, 2) the centres of the rooms' cells, and (P,) their rooms."""
        x, y = np.nonzero(self.room >= 0)
        return self.origin + (np.stack((x, y), axis=1) + 0.5) * STEP_M, self.room[x, y]

    def cells(self, places: Array) -> tuple[Index, Index, NDArray[np.bool_]]:
        """Row and column of places (..., 2), and whether they are in the raster."""
        at = np.floor((places - self.origin) / STEP_M).astype(np.int64)
        known = np.asarray(((at >= 0) & (at < self.room.shape)).all(axis=-1))
        at = np.where(known[..., None], at, 0)
        return at[..., 0], at[..., 1], known

    def room_at(self, places: Array) -> Index:
        """(...,) the rooms at places (..., 2), -1 where there is none."""
        x, y, known = self.cells(places)
        return np.where(known, self.room[x, y], -1)

    def is_inside(self, places: Array) -> NDArray[np.bool_]:
        """Whether places (..., 2) are in a room, away from its outline."""
        x, y, known = self.cells(places)
        return np.asarray(known & self.inside[x, y])
