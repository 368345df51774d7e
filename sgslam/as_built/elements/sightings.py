"""What the keyframes saw of planned elements: each ray against the surface that it meets first in the plan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.as_built.elements.rays import SeenRays
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
CELL = 0.25  # m, side of the cells of a surface that count once for each keyframe
_DECIMETRES = 10  # of a normal's components, by which the faces of an element are distinguished


@dataclass(frozen=True)
class Sightings:
    """N sightings, one for each keyframe, cell of a surface: what was measured in it, in the median.

    `element`, `view` are indices. `offset` (m) is the place of what was met, along the planned normal towards the
    sensor: negative where rays go on behind the surface. `normal` (N, 3) is that normal, `cell` (N, 3) the cell.
    """

    element: Ints
    view: Ints
    offset: Floats
    normal: Floats
    cell: Ints


def sightings(seen: SeenRays) -> Sightings:
    """All sightings of the solids that the rays were compared with."""
    parts = [_of_view(seen, k) for k in range(len(seen.views))]
    rows = np.concatenate([np.empty((0, 9)), *parts])
    whole = rows[:, [0, 1, 6, 7, 8]].astype(np.int64)
    return Sightings(whole[:, 0], whole[:, 1], rows[:, 2], rows[:, 3:6], whole[:, 2:])


def _of_view(seen: SeenRays, number: int) -> Floats:
    """(M, 9) element, view, offset, normal and cell."""
    rays, measured, planned, face = seen.of_view(number)
    met = (face >= 0) & (planned < SENSOR.furthest)
    rays, measured, planned, face = rays[met], measured[met], planned[met], face[met]
    normal = seen.normal[face]
    cosine = -np.sum(normal * rays, axis=1)
    normal = np.where(cosine[:, None] < 0, -normal, normal)
    cosine = np.abs(cosine)
    good = cosine > SENSOR.least_cosine
    rays, normal, face = rays[good], normal[good], face[good]
    offset = (planned[good] - measured[good]) * cosine[good]
    cell = np.floor((seen.views[number].sensor + planned[good, None] * rays) / CELL).astype(np.int64)
    key = np.column_stack([seen.owner[face], np.rint(_DECIMETRES * normal).astype(np.int64), cell])
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((offset, group.ravel()))
    counts = np.bincount(group.ravel(), minlength=len(first))
    last = np.cumsum(counts) - 1
    median = (offset[order[last - counts // 2]] + offset[order[last - (counts - 1) // 2]]) / 2
    return np.column_stack([
        seen.owner[face][first], np.full(len(first), number), median, normal[first], cell[first],
    ])  # fmt: skip
