"""Wall alignment: which planned wall each mapped one stands at, how far off, and which agree on the map's place."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from data.geometry import se2
from sgslam.anchoring.se2_consensus import Pairs, find_consensus
from sgslam.config import AnchorSettings
from sgslam.config.sensor import BUILDING
from sgslam.geometry.frames import transform_planes
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
_LEAST_OVERLAP = 0.3  # of the shorter wall with the other, and of the mapped wall with all planned walls in one plane


@dataclass(frozen=True)
class AlignedWall:
    """A mapped wall surface and the planned one that it stands at.

    `offset` (m) is along the planned inward normal. `agrees`: it agrees with the consensus.
    """

    surface: WallSurface
    planned: WallSurface
    offset: float
    agrees: bool


@dataclass(frozen=True)
class WallAlignment:
    """All walls that stand at a planned one, and the place (3,), T_local_level, that most of them agree on.

    `gate` (m) is how closely they agree, `share` their share of the votes.
    """

    walls: list[AlignedWall]
    place: Floats
    gate: float
    share: float


@dataclass(frozen=True)
class WallArrays:
    """N wall surfaces in plan view: centres and normals (N, 2), half lengths (N,)."""

    centre: Floats
    normal: Floats
    half: Floats

    @staticmethod
    def of(surfaces: list[WallSurface], origin: Floats) -> "WallArrays":
        """Arrays of surfaces, moved by -`origin` (2,)."""
        centre = np.array([w.centroid for w in surfaces], dtype=float).reshape(-1, 2) - origin
        normal = np.array([w.normal for w in surfaces], dtype=float).reshape(-1, 2)
        return WallArrays(centre, normal, np.array([0.5 * (w.length or 1.0) for w in surfaces]))

    def moved(self, T_plan_map: Floats) -> "WallArrays":
        """The surfaces under a motion (3,), yaw x y."""
        return replace(self, centre=se2.apply(T_plan_map, self.centre), normal=se2.rotate(T_plan_map[0], self.normal))


def align_walls(
    scene: Scene, walls: WallMap, floor: SceneGraph, origin: Floats, known: Floats, settings: AnchorSettings
) -> WallAlignment | None:
    """Aligns the walls of `scene` to a storey of the plan by position; None where they do not agree on a place.

    `known` (3,) is T_local_level, yaw x y, to half a metre; the local frame is the BIM frame moved by -`origin` (2,).
    """
    seen, planned = list(scene.graph.wall_surfaces), list(floor.wall_surfaces)
    s, a = _arrays_now(seen, scene, walls), WallArrays.of(planned, origin)
    place = known
    for _ in range(2):  # what stands where depends on the place, and the place on that
        which = associate_walls(s.moved(place), a, settings.reach)
        i = np.flatnonzero(which >= 0)
        j = which[i]
        units = _units([planned[k] for k in j.tolist()])
        pairs = Pairs(s.centre[i], s.normal[i], a.centre[j], a.normal[j], 2 * s.half[i], units)
        found = find_consensus(pairs, place)
        if found is None:
            return None
        place, agree, gate, share = found
    each = zip(i.tolist(), j.tolist(), pairs.offsets(place).tolist(), agree.tolist(), strict=True)
    aligned = [AlignedWall(seen[m], planned[n], offset, agrees) for m, n, offset, agrees in each]
    # a wall that stands nowhere in the plan counts against the place, like one that is off
    length = float(s.half[i].sum() / s.half.sum())
    return WallAlignment(aligned, place, gate, share * length)


def associate_walls(seen: WallArrays, planned: WallArrays, reach: float) -> Index:
    """(N,) the planned wall that each mapped one, already placed in the plan, stands at; -1 for none.

    Candidates face the same way, lie within `reach` metres across, and overlap a good part of the shorter wall. The
    nearest is taken, where what does not overlap is farther by up to the reach. A mapped wall off the plane is not
    associated with a short stub of the plan.
    """
    if not len(seen.half) or not len(planned.half):
        return np.full(len(seen.half), -1, dtype=np.int64)
    away = seen.centre[:, None] - planned.centre[None]
    off = np.abs(np.einsum("ijk,jk->ij", away, planned.normal))
    along = np.abs(away[..., 1] * planned.normal[:, 0] - away[..., 0] * planned.normal[:, 1])
    shorter = 2 * np.minimum(seen.half[:, None], planned.half[None])
    overlap = np.clip(seen.half[:, None] + planned.half[None] - along, 0.0, shorter)
    facing = seen.normal @ planned.normal.T > np.cos(BUILDING.one_wall)
    # of the mapped wall, by all planned walls in the plane of each
    explained = np.where(facing, overlap, 0.0) @ _in_one_plane(planned) / (2 * seen.half[:, None])
    possible = facing & (off < reach) & (overlap > _LEAST_OVERLAP * shorter)
    possible &= (off < BUILDING.thinnest_wall) | (explained > _LEAST_OVERLAP)
    cost = np.where(possible, off + reach * (1 - overlap / shorter), np.inf)
    best = cost.argmin(axis=1)
    return np.where(possible[np.arange(len(best)), best], best, -1)


def _in_one_plane(walls: WallArrays) -> NDArray[np.bool_]:
    """(N, N) flags of walls that face the same way in one plane."""
    away = np.einsum("ijk,ik->ij", walls.centre[None] - walls.centre[:, None], walls.normal)
    return np.asarray((np.abs(away) < BUILDING.thinnest_wall) & (walls.normal @ walls.normal.T > BUILDING.parallel))


def planar_pose(T: Floats) -> Floats:
    """(3,) yaw x y of a rigid motion (4, 4)."""
    return np.array([np.arctan2(T[1, 0], T[0, 0]), T[0, 3], T[1, 3]])


def _arrays_now(seen: list[WallSurface], scene: Scene, walls: WallMap) -> WallArrays:
    """Wall surfaces of a scene by the present estimates of their planes."""
    arrays = WallArrays.of(seen, np.zeros(2))
    if not seen:
        return arrays
    planes = np.stack([walls.planes_in_map[scene.wall_of_surface[w.id]] for w in seen])
    planes = transform_planes(walls.T_level_map, planes)
    scale = np.hypot(planes[:, 0], planes[:, 1])
    normal, offset = planes[:, :2] / scale[:, None], planes[:, 3] / scale
    across = np.sum(arrays.centre * normal, axis=1) + offset
    return WallArrays(arrays.centre - across[:, None] * normal, normal, arrays.half)


def _units(planned: list[WallSurface]) -> Index:
    """(N,) the straight wall of the building that each planned surface belongs to, numbered."""
    first: list[WallSurface] = []  # surface of each
    units = np.empty(len(planned), dtype=np.int64)
    for k, p in enumerate(planned):
        units[k] = next((n for n, other in enumerate(first) if _of_one_wall(p, other)), len(first))
        if units[k] == len(first):
            first.append(p)
    return units


def _of_one_wall(one: WallSurface, other: WallSurface) -> bool:
    """Whether two planned surfaces are of one straight wall; a wall of the plan's source may go round corners."""
    if one.id == other.id or not one.source or one.source != other.source:
        return one.id == other.id
    (nx, ny), (mx, my) = one.normal, other.normal
    across = (one.centroid[0] - other.centroid[0]) * mx + (one.centroid[1] - other.centroid[1]) * my
    return abs(nx * mx + ny * my) > BUILDING.parallel and abs(across) < BUILDING.thickest_wall
