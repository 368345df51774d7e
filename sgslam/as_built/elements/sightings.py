"""What the keyframes saw of planned elements: each ray against the surface that it meets first in the plan."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
CELL = 0.25  # m, side of the cells of a surface that count once for each keyframe
LEAST_COSINE = 0.3  # of the angle of incidence; at grazing rays the range says little of the surface's place
FURTHEST_RAY = 12.0  # m, beyond which a pose's turn of half a degree moves a hit by a decimetre
_DECIMETRES = 10  # of a normal's components, by which the faces of an element are distinguished


@dataclass(frozen=True)
class View:
    """One keyframe: `points` (N, 3) in the sensor frame, `T_bim_sensor` (4, 4), standard deviations `sigma` (m) of its
    position and `sigma_heading` (rad) of its turn about the vertical."""

    points: NDArray[np.float32]
    T_bim_sensor: Floats
    sigma: float
    sigma_heading: float


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


def sightings(elements: list["PlannedElement"], views: Iterable[View]) -> Sightings:
    """All sightings of the elements that are solid in the plan, or of openings alone."""
    triangles = np.concatenate([element.triangles for element in elements])
    owner = np.repeat(np.arange(len(elements)), [len(element.triangles) for element in elements])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    scene = TriangleScene(triangles)
    parts = [_of_view(scene, owner, normals, view, k) for k, view in enumerate(views)]
    rows = np.concatenate([part for part in parts if len(part)] or [np.empty((0, 9))])
    whole = rows[:, [0, 1, 6, 7, 8]].astype(np.int64)
    return Sightings(whole[:, 0], whole[:, 1], rows[:, 2], rows[:, 3:6], whole[:, 2:])


def _of_view(scene: TriangleScene, owner: Ints, normals: Floats, view: View, number: int) -> Floats:
    """(M, 9) element, view, offset, normal and cell."""
    R, origin = view.T_bim_sensor[:3, :3], view.T_bim_sensor[:3, 3]
    rays = view.points.astype(np.float64) @ R.T
    measured = np.linalg.norm(rays, axis=1)
    rays /= np.maximum(measured, 1e-9)[:, None]
    planned, face = scene.faces(origin, rays)
    normal = normals[face]
    cosine = -np.sum(normal * rays, axis=1)
    normal = np.where(cosine[:, None] < 0, -normal, normal)
    cosine = np.abs(cosine)
    good = (face >= 0) & (cosine > LEAST_COSINE) & (planned < FURTHEST_RAY)
    rays, normal = rays[good], normal[good]
    offset = (planned[good] - measured[good]) * cosine[good]
    cell = np.floor((origin + planned[good, None] * rays) / CELL).astype(np.int64)
    key = np.column_stack([owner[face[good]], np.rint(_DECIMETRES * normal).astype(np.int64), cell])
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((offset, group.ravel()))
    counts = np.bincount(group.ravel(), minlength=len(first))
    last = np.cumsum(counts) - 1
    median = (offset[order[last - counts // 2]] + offset[order[last - (counts - 1) // 2]]) / 2
    return np.column_stack([
        owner[face[good]][first], np.full(len(first), number), median, normal[first], cell[first],
    ])  # fmt: skip
