"""Returns that nothing planned explains, in cells of a grid."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from sgslam.as_built.elements import Finding
from sgslam.as_built.elements.likelihoods import LEAST_VIEWS, REACH
from sgslam.as_built.elements.rays import SeenRays
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
GRID = 0.1  # m, side of a cell: as far apart as the points of a keyframe, and five times the scatter of a range
_MOST = 2**20  # cells along an axis
# towards which something that stands there is looked for
_AROUND = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)])


def unexplained(
    rays: SeenRays, solids: Sequence[PlannedElement], found: Sequence[Finding], others: Floats
) -> Floats:  # fmt: skip
    """(N, 3) the middles of the cells, metres in the BIM frame, in which enough keyframes met something that is neither
    one of the solids, where they were planned or `found`, nor one of the `others` (M, 3, 3), bodies that are planned
    besides and not judged."""
    if not rays.views:
        return np.empty((0, 3))
    origin = np.floor(rays.views[0].sensor)
    cells, counts = np.unique(
        np.concatenate([_off_plan(rays, k, origin) for k in range(len(rays.views))]), return_counts=True
    )
    middles = origin + _middles(cells[counts >= LEAST_VIEWS])
    bodies = [others, *(body for pair in zip(solids, found, strict=True) for body in _standing(*pair))]
    triangles = np.concatenate(bodies)
    if not len(middles) or not len(triangles):
        return middles
    scene = TriangleScene(triangles)
    directions = _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
    near = np.zeros(len(middles), dtype=bool)
    for direction in directions:
        left = np.flatnonzero(~near)
        near[left] = scene.distances(middles[left], np.tile(direction, (len(left), 1))) < SENSOR.apart
    return middles[~near]


def _off_plan(rays: SeenRays, number: int, origin: Floats) -> Ints:
    """The numbers of the cells about the `origin` (3,) in which a view met what is not planned there, each once."""
    direction, measured, planned, face = rays.of_view(number)
    cosine = np.ones(len(face))
    met = face >= 0
    cosine[met] = np.abs(np.sum(rays.normal[face[met]] * direction[met], axis=1))
    off = np.where(met, np.abs(planned - measured) * cosine, np.inf) > GRID
    kept = off & (measured < SENSOR.furthest)
    cell = np.floor((rays.views[number].sensor - origin + measured[kept, None] * direction[kept]) / GRID).astype(
        np.int64
    )
    packed = cell + _MOST // 2
    return np.unique((packed[:, 0] * _MOST + packed[:, 1]) * _MOST + packed[:, 2])


def _middles(cells: Ints) -> Floats:
    x, y, z = cells // _MOST**2, cells // _MOST % _MOST, cells % _MOST
    return np.asarray((np.column_stack([x, y, z]) - _MOST // 2 + 0.5) * GRID)


def _standing(element: PlannedElement, found: Finding) -> list[Floats]:
    """The body of an element where it is planned, and where it was found; none of what is absent."""
    if found.verdict == "absent":
        return []
    if found.offset is None or found.direction is None or abs(found.offset) > REACH:
        return [element.triangles]
    return [element.triangles, element.triangles + found.offset * np.array(found.direction)]
