"""Wall alignment: which planned wall each mapped one stands at, how far off, and which agree on the map's place."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from sgslam.anchoring.se2_consensus import Pairs, find_consensus
from sgslam.anchoring.wall_association import GATE_ANGLE, WallArrays, associate_walls
from sgslam.config import AnchorSettings
from sgslam.geometry.frames import transform_planes
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
Surfaces = list[tuple[WallSurface, WallSurface]]  # seen, planned
_PARALLEL, _THICKEST = 0.999, 0.7  # cosine, and m between the sides of one straight wall
_LEAST_AGREEING = 0.3  # of a match's walls, that agree on the map's place
_GROSS = 0.7, np.radians(10)  # m and rad; matched pairs that are further off are ignored


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
    s_rooms = {room.id: k for k, room in enumerate(scene.graph.rooms)}
    a_rooms = {room.id: k for k, room in enumerate(floor.rooms)}
    s, a = _arrays_now(seen, s_rooms, scene, walls), WallArrays.of(planned, a_rooms, origin)
    place = known
    while True:  # what stands where depends on the place, and the place on that
        which = associate_walls(s.moved(place), a, settings.reach, GATE_ANGLE)
        paired = np.flatnonzero(which >= 0)
        pairs = _pairs(s, a, paired, which[paired], [planned[j] for j in which[paired].tolist()])
        found = find_consensus(pairs, place, GATE_ANGLE)
        if found is None:
            return None
        if place is not known:
            break
        place = found.T_plan_map
    place = found.T_plan_map
    off = pairs.offsets(place).tolist()
    aligned = [
        AlignedWall(seen[i], planned[int(which[i])], off[k], bool(found.agree[k]))
        for k, i in enumerate(paired.tolist())
    ]
    # a wall that stands nowhere in the plan counts against the place, like one that is off
    length = float(s.half[paired].sum() / s.half.sum())
    return WallAlignment(aligned, place, found.gate, found.share * length)


def place_from_match(
    matched: Surfaces, scene: Scene, walls: WallMap, origin: Floats, rough: Floats, settings: AnchorSettings
) -> Floats | None:
    """The place (3,), T_local_level, near the `rough` one of a match that most of its walls agree on.

    None where fewer than `least_agreeing` of them (by their votes) do, or where they leave a direction free.
    """
    seen, planned = [s for s, _ in matched], [a for _, a in matched]
    s, a = _arrays_now(seen, {}, scene, walls), WallArrays.of(planned, {}, origin)
    every = np.arange(len(matched))
    pairs = _pairs(s, a, every, every, planned)
    near = (np.abs(pairs.offsets(rough)) < _GROSS[0]) & (np.abs(pairs.turns(rough)) < _GROSS[1])
    pairs = _pairs(s, a, every[near], every[near], [p for p, good in zip(planned, near.tolist(), strict=True) if good])
    if not near.any():
        return None
    found = find_consensus(pairs, rough, GATE_ANGLE)
    if found is None or found.share * near.mean() < _LEAST_AGREEING:
        return None
    return found.T_plan_map


def planar_pose(T: Floats) -> Floats:
    """(3,) yaw x y of a rigid motion (4, 4)."""
    return np.array([np.arctan2(T[1, 0], T[0, 0]), T[0, 3], T[1, 3]])


def _arrays_now(seen: list[WallSurface], rooms: dict[str, int], scene: Scene, walls: WallMap) -> WallArrays:
    """Wall surfaces of a scene by the present estimates of their planes."""
    arrays = WallArrays.of(seen, rooms, np.zeros(2))
    if not seen:
        return arrays
    planes = transform_planes(
        walls.T_level_map, np.stack([walls.planes_in_map[scene.wall_of_surface[w.id]] for w in seen])
    )
    scale = np.hypot(planes[:, 0], planes[:, 1])
    normal, offset = planes[:, :2] / scale[:, None], planes[:, 3] / scale
    across = np.sum(arrays.centre * normal, axis=1) + offset
    return WallArrays(arrays.centre - across[:, None] * normal, normal, arrays.half, arrays.room)


def _pairs(
    s: WallArrays, a: WallArrays, i: NDArray[np.int64], j: NDArray[np.int64], planned: list[WallSurface]
) -> Pairs:
    """Pairs of mapped walls i and planned ones j; those of one straight wall of the building are one unit."""
    first: list[WallSurface] = []  # of each unit
    unit = np.empty(len(planned), dtype=np.int64)
    for k, p in enumerate(planned):
        unit[k] = next((n for n, other in enumerate(first) if _of_one_wall(p, other)), len(first))
        if unit[k] == len(first):
            first.append(p)
    return Pairs(s.centre[i], s.normal[i], a.centre[j], a.normal[j], 2 * s.half[i], unit)


def _of_one_wall(one: WallSurface, other: WallSurface) -> bool:
    """Whether two planned surfaces are of one straight wall; a wall of the plan's source may go round corners."""
    if one.id == other.id or not one.source or one.source != other.source:
        return one.id == other.id
    (nx, ny), (mx, my) = one.normal, other.normal
    across = (one.centroid[0] - other.centroid[0]) * mx + (one.centroid[1] - other.centroid[1]) * my
    return abs(nx * mx + ny * my) > _PARALLEL and abs(across) < _THICKEST
