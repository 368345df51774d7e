"""The free space of a storey as a grid, with the walls and lintels that separate rooms."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
_CELL = 0.05  # m, of the grid


@dataclass(frozen=True)
class Grid:
    """Cells of the levelled map: cell (row, column) has its centre at `origin` + (column, row) * `cell`."""

    origin: Floats  # (2,)
    cell: float
    shape: tuple[int, int]

    @staticmethod
    def around(points: Floats, cell: float) -> "Grid":
        """A grid that contains all points (N, 2) with a margin."""
        low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
        columns, rows = np.ceil((high - low) / cell).astype(int) + 1
        return Grid(low, cell, (int(rows), int(columns)))

    def to_cells(self, points: NDArray[np.floating]) -> NDArray[np.int32]:
        """(N, 2) column and row of points (N, 2), clipped to the grid."""
        cells = np.rint((points - self.origin) / self.cell).astype(np.int32)
        return np.clip(cells, 0, [self.shape[1] - 1, self.shape[0] - 1])

    def to_points(self, cells: NDArray[np.int32] | Floats) -> Floats:
        """(N, 2) points of (column, row) cells."""
        return np.asarray(cells, dtype=float) * self.cell + self.origin

    def look_up(self, image: NDArray[np.int32], points: Floats) -> NDArray[np.int32]:
        """(N,) the image's values at points (N, 2)."""
        cells = self.to_cells(points)
        return image[cells[:, 1], cells[:, 0]]


@dataclass(frozen=True)
class FreeSpace:
    """Masks (rows, columns) on a grid; `free` cells were seen free and are neither wall nor lintel."""

    grid: Grid
    free: NDArray[np.bool_]
    wall: NDArray[np.bool_]
    lintel: NDArray[np.bool_]


def free_space(sensors: Floats, outlines: Iterable[Floats], segments: Floats, lintels: Iterable[Floats]) -> FreeSpace:
    """Draws the free space of keyframes at `sensors` (K, 2), all in the levelled map.

    `outlines` are the K contours (M, 2) around them, `segments` (S, 2, 2) the observed wall pieces, `lintels` the K
    sets of points (L, 2) above doors. A cell is a lintel where three keyframes or more have seen one.
    """
    # single precision, one after another: a long run has thousands
    near = [_within_reach(place, outline).astype(np.float32) for place, outline in zip(sensors, outlines, strict=True)]
    extent = [corner for outline in near if len(outline) for corner in (outline.min(axis=0), outline.max(axis=0))]
    grid = Grid.around(np.concatenate([sensors, np.array(extent).reshape(-1, 2)]), _CELL)
    free = np.zeros(grid.shape, np.uint8)
    for outline in near:
        if len(outline) >= 3:
            cv2.fillPoly(free, [grid.to_cells(outline)], 1)
    wall = np.zeros(grid.shape, np.uint8)
    for first, last in np.rint((segments - grid.origin) / grid.cell).astype(int).tolist():
        cv2.line(wall, first, last, 1, 1)  # clips at the border; clipping the ends instead would turn the line
    seen = np.zeros(grid.shape, np.int32)
    for points in lintels:
        if len(points):
            cells = grid.to_cells(points)
            once = np.unique(cells[:, 1].astype(np.int64) * grid.shape[1] + cells[:, 0])
            seen.ravel()[once] += 1
    over_door = cv2.morphologyEx((seen >= 3).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return FreeSpace(grid, (free > 0) & (wall == 0) & (over_door == 0), wall > 0, over_door > 0)


def _within_reach(sensor: Floats, outline: Floats) -> Floats:
    away = outline - sensor
    distance = np.hypot(away[:, 0], away[:, 1])
    return sensor + away * np.minimum(1.0, SENSOR.furthest / np.maximum(distance, 1e-9))[:, None]
