"""Generated buildings as IFC files whose walls, doors, windows and columns are elements of their own.

The same plan and seed give the same building.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.generation.demo_building import DOOR, SLAB, Opening, PlanWall, write_wall
from data.generation.level_building import STOREY, prisms
from data.generation.straight_walls import (
    TILT,
    StraightWall,
    footprints,
    outline_of,
    straight_walls,
    without_features,
)
from data.geometry.areas import Area, united
from data.ifc.writer import IfcWriter, placed
from data.scene_graph import SceneGraph

Rng = np.random.Generator
Array = NDArray[np.float64]
OUTER = (0.24, 0.3, 0.36)  # m, thickness of outer walls
HEIGHTS = (2.6, 3.2)  # m, clear
WINDOWS, BAY, GLAZED = (1.0, 1.8), 2.4, 0.85  # m: widths, and the least distance of their middles; share of the bays
COLUMNS, SIDES = (2, 8), (0.25, 0.5)  # fewest and most of a building, fewer where there is no place; m
FREE = 0.6  # of the columns; the others stand in or at walls
LARGE = 15.0  # m2, of a room with free columns
CLEAR = 0.85  # m around columns, but for the wall in or at which one stands
TRIES = 60  # of a place, for each column


def write_wall_building(plan: SceneGraph, path: Path | str, seed: int) -> None:
    """Writes the only storey of a plan as an IFC file. Raises UserError for a plan of several storeys, or with walls
    that are not at right angles to each other."""
    if len(plan.floors) > 1:
        raise UserError(f"a plan of {len(plan.floors)} storeys; give one of a single storey")
    rng = np.random.default_rng([seed, 67, len(plan.rooms)])
    outer, height, width = (float(rng.choice(OUTER)), *(float(rng.uniform(*limits)) for limits in (HEIGHTS, WINDOWS)))
    T_bim_plan, rooms = _squared_rooms(plan)
    walls = straight_walls(rooms, outer)
    doors = _places(plan, T_bim_plan, walls)
    windows = [_windows(wall, rooms, at, width, rng) for wall, at in zip(walls, doors, strict=True)]
    writer = IfcWriter(f"Walls {seed}", {STOREY: 0.0}, T_bim_plan)
    areas, holes = footprints(walls, rooms, outer), list[Area]()
    for number, (wall, area, at, panes) in enumerate(zip(walls, areas, doors, windows, strict=True), 1):
        openings = [Opening(u, DOOR) for u in at], [Opening(u, width) for u in panes]
        holes += [wall.box(o.middle - o.width / 2, o.middle + o.width / 2) for some in openings for o in some]
        write_wall(writer, STOREY, f"Wall {number}", _plan_wall(wall, *openings), area, height)
    for number, column in enumerate(_columns(rooms, walls, holes, rng), 1):
        writer.element("IfcColumn", f"Column {number}", STOREY, prisms(column, 0.0, height), kind="COLUMN")
    for kind, low in (("BASESLAB", -SLAB), ("ROOF", height)):
        writer.element("IfcSlab", "Slab", STOREY, prisms(outline_of(rooms, outer), low, low + SLAB), kind=kind)
    for number, room in enumerate(rooms, 1):
        writer.space(f"{number}", STOREY, prisms(room, 0.0, height)[0])
    writer.save(path)


def _squared_rooms(plan: SceneGraph) -> tuple[Array, list[Area]]:
    """T_bim_plan (4, 4), and the rooms in the plan's frame, whose axes run along their walls. Raises UserError."""
    rings = [np.array(room.polygon) for room in plan.rooms if room.polygon is not None]
    sides = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
    x, y = sides[np.hypot(*sides.T).argmax()]
    T_bim_plan = placed(float(rings[0][0, 0]), float(rings[0][0, 1]), yaw=float(np.arctan2(y, x)))
    R, t = T_bim_plan[:2, :2], T_bim_plan[:2, 3]
    if np.abs(sides @ R).min(axis=1).max() > TILT:
        raise UserError("a plan with walls that are not at right angles; give one whose rooms are rectangular")
    return T_bim_plan, [without_features(shapely.Polygon((ring - t) @ R)) for ring in rings]


def _places(plan: SceneGraph, T_bim_plan: Array, walls: Sequence[StraightWall]) -> list[list[float]]:
    """For each wall the places of its doors along it."""
    places: list[list[float]] = [[] for _ in walls]
    areas = np.array([wall.area for wall in walls], dtype=object)
    for door in plan.doors:
        at = (np.array(door.centroid) - T_bim_plan[:2, 3]) @ T_bim_plan[:2, :2]
        k = int(shapely.distance(areas, shapely.Point(at)).argmin())
        places[k].append(float(at[walls[k].axis]))
    return places


def _windows(wall: StraightWall, rooms: Sequence[Area], doors: Sequence[float], width: float, rng: Rng) -> list[float]:
    """The places of windows along an outer wall: in the middle of bays of its rooms, away from its doors."""
    if not wall.inward:
        return []
    found = []
    for room in rooms:
        along = wall.shifted(wall.inward * BAY / 4).met(wall.low, wall.high, [room])
        if len(along) == 0:
            continue
        low, high = float(along.min()), float(along.max())
        bays = int((high - low) / BAY)
        found += [low + (k + 0.5) * (high - low) / bays for k in range(bays) if rng.random() < GLAZED]
    return [u for u in found if all(abs(u - door) > (width + DOOR) / 2 + 0.3 for door in doors)]


def _plan_wall(wall: StraightWall, doors: Sequence[Opening], windows: Sequence[Opening]) -> PlanWall:
    """With the building to its left."""
    middle = (wall.near + wall.far) / 2
    (x0, y0), (x1, y1) = ((u, middle)[:: 1 - 2 * wall.axis] for u in (wall.low, wall.high))
    ends = ((x0, y0), (x1, y1))
    start, end = ends[::-1] if wall.inward == (1 if wall.axis else -1) else ends
    return PlanWall(start, end, wall.far - wall.near, tuple(doors), tuple(windows))


def _columns(rooms: Sequence[Area], walls: Sequence[StraightWall], holes: Sequence[Area], rng: Rng) -> list[Area]:
    """Free columns in large rooms, square or round, and square ones in or at walls; all clear of doors and windows."""
    count, found = int(rng.integers(*COLUMNS, endpoint=True)), list[Area]()
    inside, areas = united(rooms), np.array([wall.area for wall in walls], dtype=object)
    large = [room for room in rooms if room.area > LARGE]
    for _ in range(TRIES * count):
        half, own = float(rng.uniform(*SIDES)) / 2, len(walls)
        if rng.random() < FREE and large:
            room = large[int(rng.integers(len(large)))]
            x0, y0, x1, y1 = room.bounds
            at = shapely.Point(rng.uniform((x0, y0), (x1, y1)))
            column = at.buffer(half, cap_style="round" if rng.random() < 0.5 else "square")
        else:
            own = int(rng.integers(len(walls)))
            wall, u = walls[own], float(rng.uniform(walls[own].low, walls[own].high))
            across = float(rng.choice([wall.near - half, (wall.near + wall.far) / 2, wall.far + half]))
            at = shapely.Point((u, across)[:: 1 - 2 * wall.axis])
            column, room = at.buffer(half, cap_style="square"), inside.union(wall.area)
        others = [*np.delete(areas, own if own < len(areas) else []), *holes, *found]
        if room.buffer(TILT).contains(column) and shapely.distance(column, others).min() > CLEAR:
            found.append(column)
        if len(found) == count:
            break
    return found
