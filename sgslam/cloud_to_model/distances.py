"""Signed distances of points from a building's planned surfaces, as cloud-to-mesh distances in CloudCompare.

A wall has two faces, and a wall that stands off by more than half its thickness comes nearer to its other face.
Therefore only faces count that can be seen from where the point was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sgslam.cloud_to_model.library import load_open3d

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
BIN_M = 0.005  # of a histogram of distances
_AXES = np.concatenate([np.eye(3), -np.eye(3)])  # faces are sorted by the axis that their normal is nearest to


@dataclass(frozen=True, eq=False)
class CloudToModel:
    """N points (N, 3) in the BIM frame, metres.

    `distance` (N,) is that along the normal of the nearest planned face seen from the sensor: positive where the point
    lies before it, negative behind; NaN where none lies within `reach` (m). `element` (N,) is the index of the face's
    element, -1 there. `side` (N,) distinguishes the faces of an element: it is the index of the axis of the BIM frame
    that the normal is nearest to: x, y, z, then -x, -y, -z.
    """

    points: Floats
    distance: Floats
    element: Ints
    side: Ints
    reach: float

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(N,) whether a planned surface is near."""
        return self.element >= 0

    @property
    def edges(self) -> Floats:
        """The edges (m) of the bins of a histogram."""
        return np.arange(-self.reach, self.reach + BIN_M / 2, BIN_M)


def distances_to_model(
    points: Floats, towards_sensor: Floats, elements: Sequence["PlannedElement"], reach: float
) -> CloudToModel:
    """The distances of points (N, 3) in the BIM frame, with unit vectors (N, 3) towards the sensor that saw them.

    Openings are no surfaces. Raises UserError where Open3D is missing.
    """
    solids = [(k, element) for k, element in enumerate(elements) if element.kind == "solid"]
    best = _Best(points, reach)
    if solids:
        triangles = np.concatenate([_outward(element.triangles) for _, element in solids])
        owner = np.repeat([k for k, _ in solids], [len(element.triangles) for _, element in solids])
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        sound = length > 0
        normals, triangles, owner = normals[sound] / length[sound, None], triangles[sound], owner[sound]
        nearest = np.argmax(normals @ _AXES.T, axis=1)
        for side in range(len(_AXES)):
            of = np.flatnonzero(nearest == side)
            if len(of):
                best.improve(triangles[of], normals[of], owner[of], side, towards_sensor)
    return CloudToModel(points, best.distance, best.element, best.side, reach)


class _Best:
    """The nearest face so far of each point."""

    def __init__(self, points: Floats, reach: float) -> None:
        self._points, self._reach = points, np.full(len(points), reach)
        self.distance = np.full(len(points), np.nan)
        self.element = np.full(len(points), -1)
        self.side = np.full(len(points), -1)

    def improve(self, triangles: Floats, normals: Floats, owner: Ints, side: int, towards_sensor: Floats) -> None:
        """Takes those of the triangles (M, 3, 3) that are nearer, where they face the sensor."""
        face, closest = _closest(triangles, self._points)
        off = self._points - closest
        away = np.linalg.norm(off, axis=1)
        facing = np.einsum("ij,ij->i", normals[face], towards_sensor) > 0
        taken = np.flatnonzero(facing & (away <= self._reach))
        before = np.einsum("ij,ij->i", off[taken], normals[face[taken]]) >= 0
        self._reach[taken] = away[taken]
        self.distance[taken] = np.where(before, away[taken], -away[taken])
        self.element[taken] = owner[face[taken]]
        self.side[taken] = side


def _outward(triangles: Floats) -> Floats:
    """The triangles (M, 3, 3) of a body, turned so that their normals point out of it: models do both."""
    a, b, c = (triangles - triangles.reshape(-1, 3).mean(axis=0)).transpose(1, 0, 2)
    return triangles if np.einsum("ij,ij->", a, np.cross(b, c)) >= 0 else triangles[:, ::-1]


def _closest(triangles: Floats, points: Floats) -> tuple[Ints, Floats]:
    """(N,) the triangle nearest to each point, and (N, 3) its nearest place; about a local origin, because Open3D
    counts in float32."""
    o3d = load_open3d()
    corners = triangles.reshape(-1, 3)
    origin = (corners.min(axis=0) + corners.max(axis=0)) / 2
    scene = o3d.t.geometry.RaycastingScene()
    faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor((corners - origin).astype(np.float32)), o3d.core.Tensor(faces))
    found = scene.compute_closest_points(o3d.core.Tensor((points - origin).astype(np.float32)))
    return found["primitive_ids"].numpy().astype(np.int64), found["points"].numpy().astype(np.float64) + origin
