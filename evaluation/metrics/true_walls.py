"""What became of each wall of a simulated storey, and from how many keyframes it could be seen."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_json
from data.geometry.raycast import TriangleScene
from data.ifc.products import IfcProduct
from data.simulation.changes import Change, Changes
from data.trajectory import Trajectory

Array = NDArray[np.float64]
_BAND = (0.9, 2.55)  # m above the floor: over most furniture, under ceilings
_ELEVATIONS = np.radians([0.0, 4.0, 8.0, 12.0, 15.0])
_AZIMUTHS = 720
_LEAST_SEEN = 0.5, 8  # m of a wall, and columns that meet it, in one stretch of one view
_GAP = 0.35  # m between columns that ends a stretch
_BEHIND = 0.5  # m; what ends nearer behind an absent wall does not show that it is absent
_SAME = 0.01  # m


@dataclass(frozen=True)
class TrueWall:
    """An IfcWall: `kind` is `as planned`, `moved`, `absent` or `unplanned`, `offset_in_bim` its shift in plan (m).

    `views` counts the keyframes that see half a metre of it in one stretch; of an absent one, that see something well
    behind half a metre of its place. `footprint` is the smallest rectangle around it as built (corners in x y, BIM
    frame).
    """

    id: str
    kind: str
    offset_in_bim: tuple[float, float]
    views: int
    footprint: tuple[tuple[float, float], ...]


def true_walls(
    ifc: Path, storey: str, changes: Changes, seed: int, truth: Trajectory, keyframes: list[int], kept: Path
) -> list[TrueWall]:
    """The storey's walls as a drive met them; `keyframes` are the numbers of the scans that are looked from.

    What has been found is kept in the file `kept` and read from there. Raises UserError for what cannot be read.
    """
    if kept.exists():
        return [_read(row) for row in json.loads(kept.read_text())]
    from data.simulation.storey_model import load_storey

    model = load_storey(ifc, storey, changes, seed)
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
    write_json(kept, [asdict(wall) for wall in walls])
    return walls


def _read(row: dict[str, Any]) -> TrueWall:
    try:
        x, y = row["offset_in_bim"]
        corners = tuple((float(u), float(v)) for u, v in row["footprint"])
        return TrueWall(row["id"], row["kind"], (float(x), float(y)), int(row["views"]), corners)
    except (KeyError, TypeError, ValueError):
        raise UserError("what a drive's walls are cannot be read; remove the drive's walls.json") from None


def _kind(wall: IfcProduct, change_of: dict[str, Change]) -> str:
    return change_of[wall.global_id].kind if wall.global_id in change_of else "as planned"


def _as_built(wall: IfcProduct, change: Change | None) -> Array:
    """(M, 3, 3) the wall where it stands; an absent one where it should."""
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
    walls: list[TriangleScene], axes: list[Array], stands: list[bool], whole: TriangleScene, built: TriangleScene,
    poses: Array, level: float,
) -> NDArray[np.int64]:  # fmt: skip
    """(N,) from how many of the sensor poses (K, 4, 4) each wall is seen, or seen through where it does not stand:
    `whole` is the building with all walls, `built` with those that stand."""
    azimuth = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    a, e = np.meshgrid(azimuth, _ELEVATIONS, indexing="ij")
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
    views = np.zeros(len(walls), dtype=np.int64)
    for origin in poses[:, :3, 3]:
        reached = whole.distances(origin, rays)
        height = origin[2] + np.where(np.isfinite(reached), reached, 0.0) * rays[:, 2] - level
        there = np.isfinite(reached) & (height > _BAND[0]) & (height < _BAND[1])
        # of each column the nearest thing in the band, as the front end sees it
        away = np.where(there, reached * np.cos(e).ravel(), np.inf).reshape(a.shape)
        asked = np.arange(_AZIMUTHS) * a.shape[1] + np.argmin(away, axis=1)
        asked = asked[there[asked]]
        if not len(asked):
            continue
        hits = origin[:2] + reached[asked, None] * rays[asked, :2]
        beyond = built.distances(origin, rays[asked])
        through = np.isfinite(beyond) & (beyond > reached[asked] + _BEHIND)
        for k, (wall, axis) in enumerate(zip(walls, axes, strict=True)):
            its = wall.distances(origin, rays[asked]) < reached[asked] + _SAME
            views[k] += _enough(hits[its & (through | stands[k])] @ axis)
    return views


def _enough(along: Array) -> bool:
    """Whether columns that meet a wall at these places (N,) show it."""
    least, columns = _LEAST_SEEN
    along = np.sort(along)
    stretches = np.split(along, np.flatnonzero(np.diff(along) > _GAP) + 1)
    return any(len(s) >= columns and s[-1] - s[0] >= least for s in stretches)
