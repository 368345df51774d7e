"""One storey of a building's mesh, for the simulation."""

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.areas import Area
from data.plans.mesh_plan import read_mesh
from data.simulation.changes import Changes
from data.simulation.storey_model import RoomLabel, Space, StoreyModel

Array = NDArray[np.float64]
UPRIGHT = 0.1  # vertical part of a wall's normal, at most
SAME_NORMAL, SAME_PLANE = 0.02, 0.02  # of a normal's parts, and m: triangles as near lie in one plane


def mesh_storey(
    path: Path | str, storey: str = "", changes: Changes | None = None, seed: int = 0, tolerance: float = 0.0
) -> StoreyModel:
    """Reads the mesh; `storey` is the id or name of a level in its A-graph, empty for the lowest. With a `tolerance`
    (m, standard deviation), each upright plane of the mesh stands off its place.

    Raises UserError for an unknown level, one without rooms, and for changes, since a mesh has no separate elements.
    """
    if changes is not None and changes.any:
        raise UserError(f"{path}: a mesh has no single walls, openings or columns to change; give an IFC file")
    building = read_mesh(path)
    names = {f.id: f.name for f in building.graph.floors}
    levels = [v for v in building.levels if v.floor is not None and storey in ("", v.floor, names[v.floor])]
    if not levels:
        raise UserError(f"{path}: no level '{storey}'; it has: {', '.join(repr(name) for name in names.values())}")
    level = levels[0]
    spaces = []
    for room in level.rooms:
        bottom = _flat(room.area, level.bottom)
        label = RoomLabel(room.room.id, room.room.name, room.room.name)
        spaces.append(Space(label, bottom, bottom + np.array([0.0, 0.0, level.top - level.bottom])))
    corners = np.concatenate([s.bottom for s in spaces]).reshape(-1, 3)[:, :2]
    extent = (corners.min(axis=0), corners.max(axis=0))
    name = names[str(level.floor)]
    solid = _shifted(building.triangles, tolerance, seed) if tolerance else building.triangles
    no_panes = np.zeros(len(solid), dtype=bool)
    return StoreyModel(str(level.floor), name, level.bottom, tuple(spaces), solid, no_panes, (), extent)


def _shifted(triangles: Array, tolerance: float, seed: int) -> Array:
    """Each upright plane moved along its normal, at random."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    upright = np.abs(normals[:, 2]) < UPRIGHT
    offsets = np.einsum("ij,ij->i", normals, triangles.mean(axis=1))
    keys = np.round(np.column_stack([normals[:, :2] / SAME_NORMAL, offsets / SAME_PLANE])).astype(int)
    _, plane = np.unique(keys, axis=0, return_inverse=True)
    shift = np.random.default_rng([seed, 102]).normal(0.0, tolerance, int(plane.max()) + 1)[plane.ravel()]
    flat = normals * [1.0, 1.0, 0.0]
    return triangles + (np.where(upright, shift, 0.0)[:, None] * flat)[:, None]


def _flat(area: Area, z: float) -> Array:
    """(M, 3, 3) the area as triangles at one height."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    plan = np.array([np.asarray(part.exterior.coords)[:3] for part in parts])
    return np.dstack([plan, np.full(plan.shape[:2], z)])
