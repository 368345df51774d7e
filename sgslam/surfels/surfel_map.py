"""A local map of oriented surfels: planes in the cells of three grids that know the side from which they were seen.

Each cell keeps running sums of its points, and the plane through them (VoxelMap; Yuan et al., RA-L 2022). A thin wall
has two faces within one cell: points join a surfel only from the side it was seen from, or scans of the next room
would slip by the wall's thickness.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.planes import (
    AXIS,
    CELLS,
    CHANGED,
    COUNT,
    FULL,
    MEAN,
    NORMAL,
    OTHER,
    PLANE,
    RAY,
    SEEN,
    SIDES,
    SQUARES,
    SUM,
    SUMS,
    VALID,
    cell_of,
    fit_plane,
    key_of,
    place_of,
    rehash,
    within_block,
)
from sgslam.surfels.search import Surfels

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]


class SurfelMap:
    """Surfels in the `odom` frame: the rows after the first one of `_sums` and `_planes`, see `sgslam.surfels.planes`.

    The arrays have room for more; `_count` and `_blocks` tell how many of their rows are used.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forgets everything."""
        self._count = self._blocks = 1
        self._table, self._cells = np.zeros((1 << 8, 2), np.int64), np.zeros((1 << 7, CELLS), np.int32)
        self._sums, self._planes = np.zeros((1 << 10, SUMS)), np.zeros((1 << 10, PLANE), np.float32)

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, without the arrays' room for more."""
        rows = {"_sums": self._sums[: self._count], "_planes": self._planes[: self._count]}
        return {**vars(self), **rows, "_cells": self._cells[: self._blocks]}

    def add(self, points: Floats, rays: Floats, way: float, memory: float) -> None:
        """Adds points (N, 3) seen along unit rays (N, 3), both in `odom`, after `way` metres.

        Surfels that were not seen for `memory` metres start again.
        """
        self._make_room(len(points))
        self._count, self._blocks = _add(
            points, rays, self._table, self._cells, self._sums, self._planes, self._count, self._blocks, way, memory
        )

    def add_scan(self, points: Floats, T_odom_sensor: Floats) -> None:
        """Adds points (N, 3) in the frame of a sensor at a pose (4, 4); nothing is ever old."""
        turned = points @ T_odom_sensor[:3, :3].T
        self.add(turned + T_odom_sensor[:3, 3], turned / np.linalg.norm(turned, axis=1, keepdims=True), 0.0, 1.0)

    @property
    def arrays(self) -> Surfels:
        """The arrays themselves, not copies."""
        return Surfels(self._table, self._cells, self._planes)

    def surfels(self) -> tuple[Floats, Floats, Floats]:
        """Means (N, 3), normals (N, 3) to the side seen from, and numbers of points (N,) of all planes."""
        own = np.flatnonzero(self._planes[: self._count, VALID] > 0)
        planes = self._planes[own].astype(np.float64)
        return planes[:, MEAN:AXIS], planes[:, NORMAL:MEAN], self._sums[own, COUNT]

    def _make_room(self, more: int) -> None:
        """Makes room for so many more points."""
        self._sums = _with_room(self._sums, self._count + len(SIDES) * more)
        self._planes = _with_room(self._planes, self._count + len(SIDES) * more)
        self._cells = _with_room(self._cells, self._blocks + more)
        while 2 * (self._blocks + more) > len(self._table):
            table, self._table = self._table, np.zeros((2 * len(self._table), 2), np.int64)
            rehash(table, self._table)


def _with_room(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """The same array (N, M), or a copy with more rows where it has fewer than `count`."""
    if count <= len(rows):
        return rows
    larger = np.zeros((2 * count, rows.shape[1]), rows.dtype)
    larger[: len(rows)] = rows
    return larger


@compiled
def _same_side(sums: Floats, planes: Floats32, s: int, rx: float, ry: float, rz: float) -> bool:
    """Whether a ray meets a surfel on the side that was seen: of its plane, or before it has one, of its rays."""
    if planes[s, VALID] > 0:
        return bool(planes[s, 0] * rx + planes[s, 1] * ry + planes[s, 2] * rz < 0)
    return bool(sums[s, RAY] * rx + sums[s, RAY + 1] * ry + sums[s, RAY + 2] * rz > 0)


@compiled
def _add(
    points: Floats,
    rays: Floats,
    table: Ints,
    cells: Ints32,
    sums: Floats,
    planes: Floats32,
    count: int,
    blocks: int,
    way: float,
    memory: float,
) -> tuple[int, int]:
    """Adds points to the sums of their cells and fits their planes; returns the numbers of surfels and of
    blocks."""
    touched, changed = np.empty(len(SIDES) * len(points), np.int64), 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        rx, ry, rz = rays[p, 0], rays[p, 1], rays[p, 2]
        cell = cell_of(x, y, z)
        key = key_of(cell, 0)
        place = place_of(key, table)
        if table[place, 0] == 0:
            table[place, 0], table[place, 1] = key, blocks
            blocks += 1
        block = table[place, 1]
        for level in range(len(SIDES)):
            column = within_block(cell, level)
            s, before = int(cells[block, column]), 0
            while s > 0 and planes[s, SEEN] >= way - memory and not _same_side(sums, planes, s, rx, ry, rz):
                s, before = int(planes[s, OTHER]), s
            if s == 0:
                s, count = count, count + 1
                if before > 0:
                    planes[before, OTHER] = s
                else:
                    cells[block, column] = s
            elif planes[s, SEEN] < way - memory:
                sums[s, :] = 0.0
                planes[s, :OTHER] = 0.0
            planes[s, SEEN] = way
            if sums[s, COUNT] >= FULL:
                continue
            sums[s, COUNT] += 1
            sums[s, SUM] += x
            sums[s, SUM + 1] += y
            sums[s, SUM + 2] += z
            sums[s, SQUARES] += x * x
            sums[s, SQUARES + 1] += x * y
            sums[s, SQUARES + 2] += x * z
            sums[s, SQUARES + 3] += y * y
            sums[s, SQUARES + 4] += y * z
            sums[s, SQUARES + 5] += z * z
            sums[s, RAY] += rx
            sums[s, RAY + 1] += ry
            sums[s, RAY + 2] += rz
            if sums[s, CHANGED] == 0:
                sums[s, CHANGED] = 1
                touched[changed] = s
                changed += 1
    for i in range(changed):
        fit_plane(sums, planes, touched[i])
    return count, blocks
