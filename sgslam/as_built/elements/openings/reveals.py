"""The reveal of a planned opening: the cuboid between the two faces of its wall that is cut out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.turns import UPRIGHT
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
_AROUND = 0.5  # m around an opening, where its wall's faces count
_PARALLEL = 0.98  # cosine of the angle between faces that count as parallel


@dataclass(frozen=True)
class Reveal:
    """Unit vectors `across` and `along` (3,) the wall, BIM frame; metres along `across` of the wall's `faces`, the
    lower first, metres along `along` of the jambs `start` and `end`, z of `bottom` and `top`. `set_back` is how far (m)
    the planned leaf or pane lies behind each face, None where the plan does not tell."""

    across: Floats
    along: Floats
    faces: tuple[float, float]
    start: float
    end: float
    bottom: float
    top: float
    set_back: tuple[float | None, float | None]

    @property
    def depth(self) -> float:
        """Metres from face to face."""
        return self.faces[1] - self.faces[0]

    @property
    def width(self) -> float:
        """Metres from jamb to jamb."""
        return self.end - self.start


def reveal_of(opening: PlannedElement, wall: PlannedElement) -> Reveal | None:
    """None where the wall has no two upright faces around the opening, as a roof has none."""
    body = opening.triangles.reshape(-1, 3)
    low, high = body.min(axis=0) - _AROUND, body.max(axis=0) + _AROUND
    corners = wall.triangles
    around = np.all((corners.min(axis=1) < high) & (corners.max(axis=1) > low), axis=1)
    faces, normals, areas = _upright(corners[around])
    if not len(faces):
        return None
    parallel = np.abs(normals @ normals.T) > _PARALLEL
    across = normals[np.argmax(parallel @ areas)]
    across = across * (1.0 if tuple(across) > tuple(-across) else -1.0)
    along = np.array([-across[1], across[0], 0.0])
    places = faces[np.abs(normals @ across) > _PARALLEL].mean(axis=1) @ across
    cut = body @ across
    places = places[(places > cut.min() - SENSOR.edge) & (places < cut.max() + SENSOR.edge)]
    if not len(places) or np.ptp(places) < BUILDING.thinnest_wall:
        return None
    ends = float(places.min()), float(places.max())
    u, z = body @ along, body[:, 2]
    return Reveal(
        across, along, ends, float(u.min()), float(u.max()), float(z.min()), float(z.max()),
        _set_back(opening.filling, across, ends),
    )  # fmt: skip


def _upright(triangles: Floats) -> tuple[Floats, Floats, Floats]:
    """Upright triangles (M, 3, 3), their level unit normals (M, 3), and their areas (M,)."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    areas = np.linalg.norm(normals, axis=1)
    upright = (areas > 0) & (np.abs(normals[:, 2]) < UPRIGHT * areas)
    normals = normals[upright] * [1.0, 1.0, 0.0]
    return triangles[upright], normals / np.linalg.norm(normals, axis=1, keepdims=True), areas[upright]


def _set_back(filling: Floats | None, across: Floats, faces: tuple[float, float]) -> tuple[float | None, float | None]:
    """How far the largest part of the filling lies behind each face, without its frame and its handles."""
    if filling is None or not len(filling):
        return None, None
    triangles, normals, areas = _upright(filling)
    facing = np.abs(normals @ across) > _PARALLEL
    if not facing.any():
        return None, None
    places, areas = triangles[facing].mean(axis=1) @ across, areas[facing]
    order = np.argsort(places)
    shares = np.cumsum(areas[order]) / areas.sum()
    lower, upper = (float(places[order][np.searchsorted(shares, share)]) for share in (0.25, 0.75))
    return lower - faces[0], faces[1] - upper
