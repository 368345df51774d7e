"""Things that stand and that no plan shows: the entries `unplanned` of elements.json."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from data.geometry.intervals import Intervals, common, united
from data.scene_graph import SceneGraph, WallSurface, Xy
from sgslam.as_built.elements.rays import SeenRays
from sgslam.as_built.unplanned.stretches import (
    GRID,
    Stretch,
    is_seen_through,
    is_two_sided,
    one_wall_each,
    stretches_of,
)
from sgslam.config.sensor import BUILDING

Floats = NDArray[np.float64]
Likeness = Literal["wall-like", "furniture-like"]
_LEAST_CELLS = 8  # of a thing that is listed
_BEFORE = 0.3  # m in front of a wall, where the room is that it is seen from


@dataclass(frozen=True)
class UnplannedEntry:
    """One thing that the plan lacks.

    `kind` is `wall-like` for what is upright, thin or tall, and no cupboard before a wall. `id` is that of the mapped
    surface that shows most of it, or says where it is; `surfaces` are all that show it, both faces and pieces. `room`
    and `storey` are the plan's names, empty where it has none there. `trace` are its two ends in plan view: of a wall
    on the face that `facing` (x, y), a unit vector, points away from, else of its middle line; `length_m` is
    their distance. `height_m` is the lowest and the highest z that was seen. All in metres in the BIM frame.
    """

    id: str
    kind: Likeness
    room: str
    storey: str
    trace: tuple[Xy, Xy]
    length_m: float
    height_m: tuple[float, float]
    facing: Xy
    surfaces: tuple[str, ...]
    reason: str


def unplanned_things(
    cells: Floats,
    rays: SeenRays,
    s_graph: SceneGraph,
    T_bim_map: Floats,
    storeys: Mapping[str, str | None],
    plan: SceneGraph,
) -> list[UnplannedEntry]:
    """What the unexplained `cells` (N, 3) show: walls first. `storeys` are the plan's, by the map's floors."""
    floors = {floor.id: floor.elevation or 0.0 for floor in s_graph.floors}
    by_floor: dict[str, list[Stretch]] = {}
    for surface in s_graph.wall_surfaces:
        for stretch in stretches_of(surface, T_bim_map, floors.get(surface.floor or "", 0.0), cells):
            if not is_seen_through(stretch, rays):
                by_floor.setdefault(stretch.floor, []).append(stretch)
    found, rest = [], np.ones(len(cells), dtype=bool)
    for floor, own in by_floor.items():
        bottom = float((T_bim_map @ [0.0, 0.0, floors.get(floor, 0.0), 1.0])[2])
        planned = plan.on_floor(storeys.get(floor)).wall_surfaces
        doors = np.array([door.centroid for door in plan.doors]).reshape(-1, 2)
        for wall in one_wall_each(own):
            if _is_wall(wall, rays, bottom, planned, doors):
                found.append(_wall(wall, storeys.get(floor), plan))
                for stretch in wall:
                    rest &= ~stretch.holds(cells, 2 * GRID)
    return [*found, *_things(cells[rest], plan)]


def _is_wall(
    wall: Sequence[Stretch], rays: SeenRays, bottom: float, planned: Sequence[WallSurface], doors: Floats
) -> bool:
    """Whether the stretches of one thing are long and tall enough, and not the front of a cupboard or a door's leaf."""
    low, top = min(own.height[0] for own in wall) - bottom, max(own.height[1] for own in wall) - bottom
    along, across = _extent(wall)
    if along < BUILDING.shortest_wall or low > BUILDING.screen:
        return False
    if top < BUILDING.tallest_leaf and _is_leaf(wall, along, doors):
        return False
    if is_two_sided(wall) and across < BUILDING.thin_wall:
        return top > BUILDING.screen
    if top <= BUILDING.screen or any(_stands_before(stretch, planned) for stretch in wall):
        return False
    unseen = BUILDING.cupboard - top
    return unseen < 0 or (along > BUILDING.long_wall and not any(is_seen_through(own, rays, unseen) for own in wall))


def _is_leaf(wall: Sequence[Stretch], along: float, doors: Floats) -> bool:
    """Whether a thing of this length (m) ends at the hinge of one of the doors with these middles (K, 2)."""
    ends = np.concatenate([[stretch.first, stretch.last] for stretch in wall])
    away = np.linalg.norm(ends[:, None] - doors, axis=2)
    return bool(along < BUILDING.longest_leaf and (away < BUILDING.hinge).any())


def _stands_before(stretch: Stretch, planned: Sequence[WallSurface]) -> bool:
    """Whether along most of it a planned wall stands so close behind that it may be a cupboard's front."""
    middle, tangent = (stretch.first + stretch.last) / 2, np.array([-stretch.normal[1], stretch.normal[0]])
    covered: Intervals = []
    for wall in planned:
        away, half = np.array(wall.centroid) - middle, 0.5 * (wall.length or 0.0)
        if wall.normal @ stretch.normal > 0.95 and -BUILDING.cupboard_depth < float(away @ stretch.normal) < 0:
            along = float(away @ tangent)
            covered.append((along - half, along + half))
    own = common([(-stretch.length / 2, stretch.length / 2)], united(covered))
    return sum(last - first for first, last in own) > stretch.length / 2


def _extent(wall: Sequence[Stretch]) -> tuple[float, float]:
    """Metres along its first stretch, and across."""
    n = wall[0].normal
    ends = np.concatenate([[stretch.first, stretch.last] for stretch in wall])
    return float(np.ptp(ends @ [-n[1], n[0]])), float(np.ptp(ends @ n))


def _wall(wall: Sequence[Stretch], storey: str | None, plan: SceneGraph) -> UnplannedEntry:
    longest = max(wall, key=lambda stretch: stretch.length)
    n, middle = longest.normal, (longest.first + longest.last) / 2
    tangent = np.array([-n[1], n[0]])
    along = (np.concatenate([[stretch.first, stretch.last] for stretch in wall]) - middle) @ tangent
    first, last = (middle + at * tangent for at in (along.max(), along.min()))
    low, high = min(stretch.height[0] for stretch in wall), max(stretch.height[1] for stretch in wall)
    both = " from both sides" if is_two_sided(wall) else ""
    return UnplannedEntry(
        longest.id,
        "wall-like",
        *_whereabouts((first + last) / 2 + _BEFORE * n, storey, plan),
        (_xy(first), _xy(last)),
        float(np.ptp(along)),
        (low, high),
        _xy(n),
        tuple(dict.fromkeys(stretch.id for stretch in wall)),
        f"{np.ptp(along):.1f} m long, seen over {high - low:.1f} m of height{both}",
    )


def _things(cells: Floats, plan: SceneGraph) -> Iterator[UnplannedEntry]:
    """The clusters of cells that touch."""
    if not len(cells):
        return
    pairs = cKDTree(cells).query_pairs(1.8 * GRID, output_type="ndarray")
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    _, cluster = connected_components(joined, directed=False)
    order = np.argsort(cluster, kind="stable")
    levels = sorted((floor.elevation, floor.id) for floor in plan.floors if floor.elevation is not None)
    for own in np.split(cells[order], np.flatnonzero(np.diff(cluster[order])) + 1):
        if len(own) < _LEAST_CELLS or np.ptp(own, axis=0).max() < BUILDING.least_thing:
            continue
        middle = own.mean(axis=0)
        storey = next((key for z, key in reversed(levels) if z < own[:, 2].max()), None)
        _, axes = np.linalg.eigh(np.cov((own[:, :2] - middle[:2]).T))
        along = (own[:, :2] - middle[:2]) @ axes[:, 1]
        first, last = (_xy(middle[:2] + at * axes[:, 1]) for at in (along.max(), along.min()))
        heights = float(own[:, 2].min()) - GRID / 2, float(own[:, 2].max()) + GRID / 2
        where, reason = " ".join(f"{x:.1f}" for x in middle), "that nothing planned explains"
        yield UnplannedEntry(
            f"thing at {where}",
            "furniture-like",
            *_whereabouts(middle[:2], storey, plan),
            (first, last),
            float(np.ptp(along)),
            heights,
            _xy(axes[:, 0]),
            (),
            f"{len(own)} cells of {1000 * GRID:.0f} mm {reason}",
        )


def _whereabouts(place: Floats, storey: str | None, plan: SceneGraph) -> tuple[str, str]:
    """The names of the plan's room that contains a place (2,), and of its storey; empty where it has none there."""
    rooms = (room for room in plan.rooms if room.polygon and (storey is None or room.floor in (None, storey)))
    here = (room.name or room.id for room in rooms if shapely.contains_xy(shapely.Polygon(room.polygon), *place))
    return next(here, ""), next((floor.name or floor.id for floor in plan.floors if floor.id == storey), "")


def _xy(place: Floats) -> Xy:
    x, y = place.tolist()
    return x, y


def storeys_of(matches: Mapping[str, Any] | None, s_graph: SceneGraph) -> dict[str, str | None]:
    """The plan's storey of each floor of the map; `matches` as in matches.json."""
    placed = (matches or {}).get("floors") or {}
    return {floor.id: placed.get(floor.id, (matches or {}).get("floor")) for floor in s_graph.floors}
