"""Wall alignment: which planned wall each mapped one stands at, how far off, and which agree on the map's place."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from data.scene_graph.segments import Segments, straight_walls
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


def align_walls(
    scene: Scene, walls: WallMap, floor: SceneGraph, origin: Floats, known: Floats, settings: AnchorSettings
) -> WallAlignment | None:
    """Aligns the walls of `scene` to a storey of the plan by position; None where they do not agree on a place.

    `known` (3,) is T_local_level, yaw x y, to half a metre; the local frame is the BIM frame moved by -`origin` (2,).
    """
    seen, planned = list(scene.graph.wall_surfaces), list(floor.wall_surfaces)
    s, a = _segments_now(seen, scene, walls), Segments.of(planned).moved(np.array([0.0, *-origin]))
    place = known
    for _ in range(2):  # what stands where depends on the place, and the place on that
        which = associate_walls(s.moved(place), a, settings.reach)
        i = np.flatnonzero(which >= 0)
        j = which[i]
        units, _ = straight_walls([planned[k] for k in j.tolist()])
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


def associate_walls(seen: Segments, planned: Segments, reach: float) -> Index:
    """(N,) the planned wall that each mapped one, already placed in the plan, stands at; -1 for none.

    Candidates face the same way, lie within `reach` metres across, and overlap a good part of the shorter wall. The
    nearest is taken, where what does not overlap is farther by up to the reach. A mapped wall off the plane is not
    associated with a short stub of the plan.
    """
    if not len(seen.half) or not len(planned.half):
        return np.full(len(seen.half), -1, dtype=np.int64)
    half = np.nan_to_num(planned.half, nan=0.5)  # of a length that the plan does not tell, 1 m
    away = seen.centre[:, None] - planned.centre[None]
    off = np.abs(np.einsum("ijk,jk->ij", away, planned.normal))
    along = np.abs(away[..., 1] * planned.normal[:, 0] - away[..., 0] * planned.normal[:, 1])
    shorter = 2 * np.minimum(seen.half[:, None], half[None])
    overlap = np.clip(seen.half[:, None] + half[None] - along, 0.0, shorter)
    facing = seen.normal @ planned.normal.T > np.cos(BUILDING.one_wall)
    # of the mapped wall, by all planned walls in the plane of each
    explained = np.where(facing, overlap, 0.0) @ _in_one_plane(planned) / (2 * seen.half[:, None])
    possible = facing & (off < reach) & (overlap > _LEAST_OVERLAP * shorter)
    possible &= (off < BUILDING.thinnest_wall) | (explained > _LEAST_OVERLAP)
    cost = np.where(possible, off + reach * (1 - overlap / shorter), np.inf)
    best = cost.argmin(axis=1)
    return np.where(possible[np.arange(len(best)), best], best, -1)


def _in_one_plane(walls: Segments) -> NDArray[np.bool_]:
    """(N, N) flags of walls that face the same way in one plane."""
    away = np.einsum("ijk,ik->ij", walls.centre[None] - walls.centre[:, None], walls.normal)
    return np.asarray((np.abs(away) < BUILDING.thinnest_wall) & (walls.normal @ walls.normal.T > BUILDING.parallel))


def planar_pose(T: Floats) -> Floats:
    """(3,) yaw x y of a rigid motion (4, 4)."""
    return np.array([np.arctan2(T[1, 0], T[0, 0]), T[0, 3], T[1, 3]])


def _segments_now(seen: list[WallSurface], scene: Scene, walls: WallMap) -> Segments:
    """Wall surfaces of a scene by the present estimates of their planes."""
    drawn = Segments.of(seen)
    if not seen:
        return drawn
    planes = np.stack([walls.planes_in_map[scene.wall_of_surface[w.id]] for w in seen])
    planes = transform_planes(walls.T_level_map, planes)
    scale = np.hypot(planes[:, 0], planes[:, 1])
    normal, offset = planes[:, :2] / scale[:, None], planes[:, 3] / scale
    across = np.sum(drawn.centre * normal, axis=1) + offset
    return Segments(drawn.centre - across[:, None] * normal, np.arctan2(normal[:, 1], normal[:, 0]), drawn.half)
