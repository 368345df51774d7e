"""Stretches of mapped wall surfaces at which nothing planned explains the returns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import WallSurface
from sgslam.as_built.elements.rays import SeenRays
from sgslam.as_built.unplanned.unexplained import GRID
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
_GAP = 0.35  # m along a surface without a return, which does not end a stretch
_LEVELS = 2  # cells above each other that show an upright thing


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of the mapped surface `id` of the map's `floor`, metres in the BIM frame: its ends `first` and `last`
    (2,), the left one (looking along its `normal` (2,), towards where it was seen from) first; lowest and highest z."""

    id: str
    floor: str
    first: Floats
    last: Floats
    normal: Floats
    height: tuple[float, float]

    @property
    def length(self) -> float:
        """m, in plan view."""
        return float(np.linalg.norm(self.last - self.first))

    def box(self) -> Floats:
        """(4, 3) its corners."""
        return np.array([[*xy, z] for xy in (self.first, self.last) for z in self.height])

    def holds(self, places: Floats, around: float) -> NDArray[np.bool_]:
        """(N,) which places (N, 3) lie on it, or within `around` (m) of it."""
        tangent = np.array([-self.normal[1], self.normal[0]])
        away = places[:, :2] - self.last
        along, low, high = away @ tangent, *self.height
        level = (places[:, 2] > low - around) & (places[:, 2] < high + around)
        beside = (along > -around) & (along < self.length + around)
        return np.asarray(level & beside & (np.abs(away @ self.normal) < around))


def stretches_of(surface: WallSurface, T_bim_map: Floats, floor_z: float, cells: Floats) -> list[Stretch]:
    """Those of a mapped surface; `floor_z` is the z of its floor in the map, `cells` (N, 3) as of `unexplained`."""
    n = T_bim_map[:2, :2] @ surface.normal
    n = n / np.linalg.norm(n)
    tangent = np.array([-n[1], n[0]])
    first, last = (
        (T_bim_map @ [*end, floor_z, 1.0])[:2] for end in surface.ends()
    )  # fmt: skip
    bottom = float((T_bim_map @ [*surface.centroid, floor_z, 1.0])[2])
    away = cells[:, :2] - last
    along = away @ tangent
    length = float(np.linalg.norm(first - last))
    low, high = surface.height or (0.0, np.inf)
    own = (np.abs(away @ n) < SENSOR.apart) & (along > 0) & (along < length)
    own &= (cells[:, 2] > bottom + low - GRID) & (cells[:, 2] < bottom + high + GRID)
    along, z = along[own], cells[own, 2]
    place, level = np.floor(along / GRID).astype(np.int64), np.floor(z / GRID).astype(np.int64)
    columns, count = np.unique(np.unique(np.column_stack([place, level]), axis=0)[:, 0], return_counts=True)
    columns = columns[count >= _LEVELS]
    if not len(columns):
        return []
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > _GAP / GRID) + 1)
    found = []
    for run in runs:
        begin, end = GRID * run[0], GRID * (run[-1] + 1)
        if end - begin >= BUILDING.least_thing:
            heights = z[(along >= begin) & (along <= end)]
            found.append(Stretch(
                surface.id, surface.floor or "", last + end * tangent, last + begin * tangent, n,
                (float(heights.min()) - GRID / 2, float(heights.max()) + GRID / 2),
            ))  # fmt: skip
    return found


def is_seen_through(stretch: Stretch, rays: SeenRays, above: float = 0.0) -> bool:
    """Whether more rays pass its place than end there; or that of something up to `above` (m) on top of it."""
    near = rays.crossing(stretch.box(), above)
    tangent = np.array([-stretch.normal[1], stretch.normal[0]])
    cosine = near.direction[:, :2] @ stretch.normal
    towards = np.abs(cosine) > 0.1
    near, cosine = near[towards], cosine[towards]
    ranges = (stretch.last - near.origin[:, :2]) @ stretch.normal / cosine
    crossed = near.at(ranges)
    along = (crossed[:, :2] - stretch.last) @ tangent
    low, high = stretch.height if above == 0.0 else (stretch.height[1], stretch.height[1] + above)
    within = (along > GRID) & (along < stretch.length - GRID) & (crossed[:, 2] > low) & (crossed[:, 2] < high)
    within &= ranges > 0
    depth = ((near.measured - ranges) * np.abs(cosine))[within]
    at, through = np.abs(depth) < SENSOR.apart, depth > 2 * SENSOR.apart
    return bool(through.sum() > at.sum())
