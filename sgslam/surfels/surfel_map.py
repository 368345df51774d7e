"""A local map of oriented surfels: planes in the cells of three grids that know the side from which they were seen.

Each cell keeps running sums of its points, and the plane through them (VoxelMap; Yuan et al., RA-L 2022). A thin wall
has two faces within one cell: points join a surfel only from the side it was seen from, or scans of the next room
would slip by the wall's thickness.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.serialization import Stateful
from sgslam.surfels.cells import SIDES, key_of, place_of, rehash
from sgslam.surfels.planes import (
    AXIS_1,
    CHANGED,
    COUNT,
    MEAN,
    NORMAL,
    PLANE,
    RAY,
    SQUARES,
    SUM,
    SUMS,
    VALID,
    fit_plane,
)
from sgslam.surfels.search import Surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FULL = 200.0  # points after which a surfel stays as it is: its mean is known to a millimetre


class SurfelMap(Stateful):
    """Surfels in the `odom` frame. `planes` (N, 17) are documented by the names of their columns."""

    _STATE = ("count", "_keys", "_first", "_other", "_sums", "planes", "_seen")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forgets everything."""
        self.count = 0
        self._keys, self._first = np.full(1 << 14, -1, np.int64), np.full(1 << 14, -1, np.int64)
        self._other = np.full(1 << 12, -1, np.int64)  # of each surfel, the one of its cell's other side
        self._sums, self.planes = np.zeros((1 << 12, SUMS)), np.zeros((1 << 12, PLANE))
        self._seen = np.zeros(1 << 12)  # m of way at which it was last seen

    def state(self) -> dict[str, Any]:
        """See `Stateful`; without the arrays' room for more."""
        rows = {name: getattr(self, name)[: self.count] for name in ("_other", "_sums", "planes", "_seen")}
        return {**super().state(), **rows}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._make_room(1)

    def add(self, points: Floats, rays: Floats, way: float, memory: float) -> None:
        """Adds points (N, 3) seen along unit rays (N, 3), both in `odom`, after `way` metres.

        Surfels that were not seen for `memory` metres start again.
        """
        self._make_room(2 * len(SIDES) * len(points))
        self.count = _add(
            points, rays, self._keys, self._first, self._other, self._sums, self.planes, self._seen, self.count, way,
            memory,
        )  # fmt: skip

    def add_scan(self, points: Floats, T_odom_sensor: Floats) -> None:
        """Adds points (N, 3) in the frame of a sensor at a pose (4, 4); nothing is ever old."""
        turned = points @ T_odom_sensor[:3, :3].T
        self.add(turned + T_odom_sensor[:3, 3], turned / np.linalg.norm(turned, axis=1, keepdims=True), 0.0, 1.0)

    @property
    def arrays(self) -> Surfels:
        """The arrays themselves, not copies."""
        return Surfels(self._keys, self._first, self._other, self.planes, self._seen)

    def surfels(self) -> tuple[Floats, Floats, Floats]:
        """Means (N, 3), normals (N, 3) to the side seen from, and numbers of points (N,) of all planes."""
        own = np.flatnonzero(self.planes[: self.count, VALID] > 0)
        return self.planes[own, MEAN:AXIS_1], self.planes[own, NORMAL:MEAN], self._sums[own, COUNT]

    def _make_room(self, more: int) -> None:
        """Makes room for so many more surfels, and for as many again as there are."""
        if self.count + more > len(self._other):
            room = max(2 * self.count, self.count + more) - len(self._other)
            self._other = np.concatenate([self._other, np.full(room, -1, np.int64)])
            self._sums = np.concatenate([self._sums, np.zeros((room, SUMS))])
            self.planes = np.concatenate([self.planes, np.zeros((room, PLANE))])
            self._seen = np.concatenate([self._seen, np.zeros(room)])
        while 2 * (self.count + more) > len(self._keys):
            keys, first = self._keys, self._first
            self._keys, self._first = np.full(2 * len(keys), -1, np.int64), np.full(2 * len(keys), -1, np.int64)
            rehash(keys, first, self._keys, self._first)


@compiled
def _same_side(sums: Floats, plane: Floats, rx: float, ry: float, rz: float) -> bool:
    """Whether a ray meets a surfel on the side that was seen: of its plane, or before it has one, of its rays."""
    if plane[VALID] > 0:
        return bool(plane[0] * rx + plane[1] * ry + plane[2] * rz < 0)
    return bool(sums[RAY] * rx + sums[RAY + 1] * ry + sums[RAY + 2] * rz > 0)


@compiled
def _add(
    points: Floats, rays: Floats, keys: Ints, first: Ints, other: Ints, sums: Floats, planes: Floats, seen: Floats,
    count: int, way: float, memory: float,
) -> int:  # fmt: skip
    """Adds points to the sums of their cells and fits the planes that changed; returns the number of surfels."""
    touched = np.empty(len(SIDES) * len(points), np.int64)
    changed = 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        rx, ry, rz = rays[p, 0], rays[p, 1], rays[p, 2]
        for level in range(len(SIDES)):
            key = key_of(x, y, z, level)
            place = place_of(key, keys)
            s, before = first[place] if keys[place] == key else -1, -1
            while s >= 0 and seen[s] >= way - memory and not _same_side(sums[s], planes[s], rx, ry, rz):
                s, before = other[s], s
            if s < 0:
                s, count = count, count + 1
                if before >= 0:
                    other[before] = s
                else:
                    keys[place], first[place] = key, s
            elif seen[s] < way - memory:
                sums[s, :], planes[s, :] = 0.0, 0.0
            seen[s] = way
            own = sums[s]
            if own[COUNT] >= _FULL:
                continue
            own[COUNT] += 1
            own[SUM] += x
            own[SUM + 1] += y
            own[SUM + 2] += z
            own[RAY] += rx
            own[RAY + 1] += ry
            own[RAY + 2] += rz
            own[SQUARES] += x * x
            own[SQUARES + 1] += x * y
            own[SQUARES + 2] += x * z
            own[SQUARES + 3] += y * y
            own[SQUARES + 4] += y * z
            own[SQUARES + 5] += z * z
            if own[CHANGED] == 0:
                own[CHANGED] = 1
                touched[changed] = s
                changed += 1
    for i in range(changed):
        s = touched[i]
        sums[s, CHANGED] = 0
        fit_plane(sums[s], planes[s])
    return count
