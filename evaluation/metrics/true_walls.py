"""Ground truth of each wall of a simulated storey: how it was built, and how many keyframes can see it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.ifc.products import IfcProduct
from data.simulation import Change, Changes
from data.trajectory import Trajectory

Array = NDArray[np.float64]
_BAND = (0.9, 2.55)  # m above the floor: over most furniture, under ceilings
_ELEVATIONS = np.radians([0.0, 4.0, 8.0, 12.0, 15.0])
_AZIMUTHS = 720
_LEAST_SEEN = 0.5, 8  # m of a wall, and columns that meet it, in one stretch of one view
_GAP = 0.35  # m between columns that ends a stretch
_BEHIND = 0.5  # m that a ray must reach behind an absent wall to show that it is absent
_SAME = 0.01  # m


@dataclass(frozen=True)
class TrueWall:
    """An IfcWall as built.

    `kind` is `as planned`, `moved`, `absent` or `unplanned`; `offset_in_bim` is its shift in plan (m). `views` counts
    the keyframes that see half a metre of it in one stretch; for an absent wall, those that see through half a metre
    of its planned place. `footprint` is its minimum rectangle (corners in x y, BIM frame).
    """

    id: str
    kind: str
    offset_in_bim: tuple[float, float]
    views: int
    footprint: tuple[tuple[float, float], ...]


def true_walls(
    ifc: Path, storey: str, changes: Changes, seed: int, truth: Trajectory, keyframes: list[int]
) -> list[TrueWall]:
    """The storey's walls as built; `keyframes` are the indices of the scans used as viewpoints."""
    from data.simulation.storey_model import load_storeys

    (model,) = load_storeys(ifc, [storey], changes, seed)
    change_of = {change.id: change for change in model.changes}
    stand = [_as_built(wall, change_of.get(wall.global_id)) for wall in model.walls]
    absent = [t for wall, t in zip(model.walls, stand, strict=True) if _kind(wall, change_of) == "absent"]
    whole, built = TriangleScene(np.concatenate([model.solid, *absent])), TriangleScene(model.solid)
    axes = [_axis(triangles) for triangles in stand]
    scenes = [TriangleScene(t) for t in stand]
    stands = [_kind(wall, change_of) != "absent" for wall in model.walls]
    views = _views(scenes, axes, stands, whole, built, truth.poses[keyframes], model.level)
    walls = []
    for wall, triangles, count in zip(model.walls, stand, views.tolist(), strict=True):
        change = change_of.get(wall.global_id)
        offset = change.offset_in_bim if change is not None else (0.0, 0.0)
        walls.append(TrueWall(wall.global_id, _kind(wall, change_of), offset, count, _footprint(triangles)))
    return walls


def _kind(wall: IfcProduct, change_of: dict[str, Change]) -> str:
    return change_of[wall.global_id].kind if wall.global_id in change_of else "as planned"


def _as_built(wall: IfcProduct, change: Change | None) -> Array:
    """(M, 3, 3) triangles of the wall as built; of an absent wall, as planned."""
    offset = (0.0, 0.0) if change is None else change.offset_in_bim
    return np.asarray((wall.vertices + np.array([*offset, 0.0]))[wall.faces])


def _footprint(triangles: Array) -> tuple[tuple[float, float], ...]:
    around = shapely.oriented_envelope(shapely.multipoints(triangles.reshape(-1, 3)[:, :2]))
    return tuple((float(x), float(y)) for x, y in around.exterior.coords[:-1])


def _axis(triangles: Array) -> Array:
    """(2,) the unit vector along the longer side."""
    corners = np.array(_footprint(triangles))
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    return np.asarray(sides[np.argmax(lengths)] / lengths.max())


def _views(
    walls: list[TriangleScene],
    axes: list[Array],
    stands: list[bool],
    whole: TriangleScene,
    built: TriangleScene,
    poses: Array,
    level: float,
) -> NDArray[np.int64]:
    """(N,) from how many of the sensor poses (K, 4, 4) each wall is seen, or, if absent, seen through.

    `whole` is the building with all walls, `built` only with those that were built; what stands behind an absent wall
    is seen.
    """
    views = np.zeros(len(walls), dtype=np.int64)
    for origin in poses[:, :3, 3]:
        met = _first_met(built, origin, level)
        planned = met if all(stands) else _first_met(whole, origin, level)
        for k, (wall, axis) in enumerate(zip(walls, axes, strict=True)):
            rays, reached = met if stands[k] else planned
            its = wall.distances(origin, rays) < reached + _SAME
            if not stands[k]:
                beyond = built.distances(origin, rays)
                its &= np.isfinite(beyond) & (beyond > reached + _BEHIND)
            hits = origin[:2] + reached[its, None] * rays[its, :2]
            views[k] += _enough(hits @ axis)
    return views


def _first_met(scene: TriangleScene, origin: Array, level: float) -> tuple[Array, Array]:
    """For each column the ray (C, 3) with the nearest return in the height band, as in the front end, and its range
    (C,) in metres; columns without one are left out."""
    azimuth = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    a, e = np.meshgrid(azimuth, _ELEVATIONS, indexing="ij")
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
    reached = scene.distances(origin, rays)
    height = origin[2] + np.where(np.isfinite(reached), reached, 0.0) * rays[:, 2] - level
    there = np.isfinite(reached) & (height > _BAND[0]) & (height < _BAND[1])
    away = np.where(there, reached * np.cos(e).ravel(), np.inf).reshape(a.shape)
    nearest = np.arange(_AZIMUTHS) * a.shape[1] + np.argmin(away, axis=1)
    nearest = nearest[there[nearest]]
    return rays[nearest], np.asarray(reached[nearest])


def _enough(along: Array) -> bool:
    """Whether columns that hit a wall at these positions along it (N,) are enough to see it."""
    least, columns = _LEAST_SEEN
    along = np.sort(along)
    stretches = np.split(along, np.flatnonzero(np.diff(along) > _GAP) + 1)
    return any(len(s) >= columns and s[-1] - s[0] >= least for s in stretches)
