"""The bodies of a plan: what a scan is compared with, and bodies for plans that are drawn flat."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import triangles_of
from data.geometry.intervals import Intervals, united, without
from data.scene_graph import WALL_HEIGHT, LevelSurface, SceneGraph, WallSurface
from data.scene_graph.segments import PARALLEL, THICKEST, Segments

Array = NDArray[np.float64]
Kind = Literal["solid", "opening"]
SHEET = 0.05  # m: depth of a wall of which one side is known
PANE = 1.5  # m2, of a window
NARROWEST = 0.3  # m: a narrower part beside a door is its frame


@dataclass(frozen=True, eq=False)
class PlannedElement:
    """One element; `triangles` (M, 3, 3) metres in the BIM frame are its body.

    Those of an opening, which a door or a window fills, are the body that is cut out of the wall; `wall` is that wall's
    GlobalId, and `filling` (K, 3, 3) the body of the door or window itself, None where it has none. `grid` names the
    grid lines at which it stands, such as B/3; empty in a model without any. `pane` is the area (m2)
    of one of the panes or openings that it has and the plan does not show, inf where all of it may be elsewhere.
    """

    global_id: str
    ifc_class: str
    name: str
    storey: str
    kind: Kind
    triangles: Array
    grid: str = ""
    wall: str = ""
    filling: Array | None = None
    pane: float = 0.0


def wall_ids(surface: WallSurface) -> tuple[str, ...]:
    """The ids of the walls that a planned surface is made of; its own where the plan does not name them."""
    sources = [source for source, *_ in surface.parts] or [surface.source]
    return tuple(dict.fromkeys(source or surface.id for source in sources))


def bodies_of(plan: SceneGraph) -> tuple[PlannedElement, ...]:
    """Walls, floors and ceilings of a plan that has surfaces alone.

    A wall's body reaches from each of its sides to the middle between both, with doors left out: where the plan does
    not name walls, each side is an element.
    """
    names = {floor.id: floor.name or floor.id for floor in plan.floors}
    rooms = {room.id: room.name or room.id for room in plan.rooms}
    walls = _Walls(plan)
    bodies: dict[str, list[Array]] = {}
    of: dict[str, WallSurface | LevelSurface] = {}
    for surface in plan.wall_surfaces:
        for source, first, last in walls.stretches(surface):
            bodies.setdefault(source or surface.id, []).append(walls.box(surface, (first, last)))
            of.setdefault(source or surface.id, surface)
    for level in plan.level_surfaces:
        bodies.setdefault(level.source or level.id, []).append(_sheet(level))
        of.setdefault(level.source or level.id, level)
    found = []
    for key, own in of.items():
        name = f"{rooms[own.room]}, {key}" if own.room in rooms else key
        if isinstance(own, WallSurface):
            kind, pane = "IfcWall", PANE
        else:
            kind, pane = own.kind or ("IfcSlab" if own.is_floor else "IfcCovering"), np.inf
        storey = names.get(own.floor or "", "")
        found.append(PlannedElement(key, kind, name, storey, "solid", np.concatenate(bodies[key]), pane=pane))
    return tuple(found)


def gaps_of(plan: SceneGraph) -> Array:
    """(M, 3, 3) the triangles of the bodies that openings leave out of the walls of a plan that has surfaces alone."""
    gaps, walls = [np.empty((0, 3, 3))], _Walls(plan)
    for surface in plan.wall_surfaces:
        half = (surface.length or 0.0) / 2
        solid = [(first, last) for _, first, last in walls.stretches(surface)]
        gaps += [walls.box(surface, gap) for gap in without([(-half, half)], solid)]
    return np.concatenate(gaps)


class _Walls:
    """The surfaces of a plan's walls, and the bodies behind them."""

    def __init__(self, plan: SceneGraph) -> None:
        self._bottom = {floor.id: floor.elevation or 0.0 for floor in plan.floors}
        self._drawn = Segments.of(plan.wall_surfaces)
        self._floor = np.array([wall.floor or "" for wall in plan.wall_surfaces], dtype=object)
        floor_of = {room.id: room.floor for room in plan.rooms}
        doors = [(door, {floor_of.get(room) for room in door.rooms}) for door in plan.doors if door.width is not None]
        self._door = np.array([door.centroid for door, _ in doors]).reshape(-1, 2)
        self._width = np.array([door.width for door, _ in doors], dtype=float)
        self._door_floors = [floors for _, floors in doors]

    def stretches(self, surface: WallSurface) -> Iterator[tuple[str, float, float]]:
        """Where along a surface, as in its parts, a wall reaches from floor to ceiling, with its source; without the
        doors where there are no parts."""
        half = (surface.length or 0.0) / 2
        cut = [] if surface.parts else self._doors_along(surface, half)
        for source, first, last, full in surface.parts or ((surface.source, -half, half, True),):
            for low, high in without([(first, last)], united(cut)):
                if full and (high - low >= NARROWEST or not (cut or surface.parts)):
                    yield source, low, high

    def box(self, surface: WallSurface, span: tuple[float, float]) -> Array:
        """(12, 3, 3) triangles from a stretch of a surface, as in its parts, to the middle of the wall."""
        low = self._bottom.get(surface.floor or "", 0.0)
        height = surface.height or (low, low + WALL_HEIGHT)
        n, left = np.array(surface.normal), np.array([-surface.normal[1], surface.normal[0]])
        front = np.array(surface.centroid) + np.outer(span, left)
        back = front - self._depth(surface, front.mean(axis=0), (span[1] - span[0]) / 2) * n
        corners = np.array([[*xy, z] for z in height for xy in (*front, *back)])
        return np.asarray(corners[_FACES])

    def _doors_along(self, surface: WallSurface, half: float) -> Intervals:
        """What doors in this wall take of the surface; a door in a wall across is further off."""
        away = self._door - surface.centroid
        along = away @ np.array([-surface.normal[1], surface.normal[0]])
        near = (np.abs(away @ np.array(surface.normal)) < THICKEST / 2) & (np.abs(along) < half)
        own = [k for k in np.flatnonzero(near).tolist() if {surface.floor, None} & self._door_floors[k]]
        return [(float(along[k] - self._width[k] / 2), float(along[k] + self._width[k] / 2)) for k in own]

    def _depth(self, surface: WallSurface, middle: Array, half: float) -> float:
        """Metres to the middle of the wall: half of what lies between a stretch about `middle` (2,) and the next
        surface that faces away behind it."""
        n = np.array(surface.normal)
        away = middle - self._drawn.centre
        behind, along = away @ n, away @ np.array([-n[1], n[0]])
        other = (behind > 0) & (behind < THICKEST) & (self._drawn.normal @ n < -PARALLEL)
        other &= (np.abs(along) < np.nan_to_num(self._drawn.half) + half) & (self._floor == (surface.floor or ""))
        return float(behind[other].min()) / 2 if other.any() else SHEET


# of a box with the corners front, front, back, back below, and the same above
_FACES = np.array([
    [0, 1, 5], [0, 5, 4], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5], [0, 1, 3], [0, 3, 2],
    [4, 5, 7], [4, 7, 6],
])  # fmt: skip


def _sheet(level: LevelSurface) -> Array:
    """(M, 3, 3) triangles of a floor or a ceiling."""
    area = shapely.make_valid(shapely.Polygon(level.polygon, level.holes))
    corners = triangles_of(area)
    z = [[level.height(x, y) for x, y in triangle] for triangle in corners.tolist()]
    return np.concatenate([corners, np.reshape(z, (-1, 3, 1))], axis=2)
