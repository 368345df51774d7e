"""The bodies of a plan: what a scan is compared with, and bodies for plans that are drawn flat."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.intervals import Intervals, united, without
from data.scene_graph import LevelSurface, SceneGraph, WallSurface

Array = NDArray[np.float64]
Kind = Literal["solid", "opening"]
THICKEST = 0.7  # m between the sides of one wall
SHEET = 0.05  # m: depth of a wall of which one side is known
HEIGHT = 2.5  # m of a wall whose height is unknown
PANE = 1.5  # m2, of a window
NARROWEST = 0.3  # m: a narrower part beside a door is its frame
PARALLEL = 0.99  # cosine between both sides of a wall


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
    bodies: dict[str, list[Array]] = {}
    of: dict[str, WallSurface | LevelSurface] = {}
    for surface in plan.wall_surfaces:
        for source, first, last in _stretches(surface, plan):
            bodies.setdefault(source or surface.id, []).append(_box(surface, plan, (first, last)))
            of.setdefault(source or surface.id, surface)
    for level in plan.level_surfaces:
        bodies.setdefault(level.source or level.id, []).append(_sheet(level))
        of.setdefault(level.source or level.id, level)
    return tuple(
        PlannedElement(
            key, _ifc_class(surface), rooms.get(surface.room or "", key), names.get(surface.floor or "", ""), "solid",
            np.concatenate(bodies[key]), pane=PANE if isinstance(surface, WallSurface) else np.inf,
        ) for key, surface in of.items()
    )  # fmt: skip


def _ifc_class(surface: WallSurface | LevelSurface) -> str:
    if isinstance(surface, WallSurface):
        return "IfcWall"
    return surface.kind or ("IfcSlab" if surface.is_floor else "IfcCovering")


def gaps_of(plan: SceneGraph) -> Array:
    """(M, 3, 3) the triangles of the bodies that openings leave out of the walls of a plan that has surfaces alone."""
    gaps = [np.empty((0, 3, 3))]
    for surface in plan.wall_surfaces:
        half = (surface.length or 0.0) / 2
        solid = [(first, last) for _, first, last in _stretches(surface, plan)]
        gaps += [_box(surface, plan, gap) for gap in without([(-half, half)], solid)]
    return np.concatenate(gaps)


def _stretches(surface: WallSurface, plan: SceneGraph) -> Iterator[tuple[str, float, float]]:
    """Where along a surface, as in its parts, a wall reaches from floor to ceiling, with its source; without doors."""
    half = (surface.length or 0.0) / 2
    cut: Intervals = []
    here = {room.id for room in plan.rooms if room.floor == surface.floor or None in (room.floor, surface.floor)}
    for door in plan.doors if not surface.parts else ():
        away = np.subtract(door.centroid, surface.centroid)
        along = float(away @ [-surface.normal[1], surface.normal[0]])
        beside = here.intersection(door.rooms)
        if beside and door.width is not None and abs(away @ surface.normal) < THICKEST / 2 and abs(along) < half:
            cut.append((along - door.width / 2, along + door.width / 2))
    for source, first, last, full in surface.parts or ((surface.source, -half, half, True),):
        for low, high in without([(first, last)], united(cut)):
            if full and (high - low >= NARROWEST or not (cut or surface.parts)):
                yield source, low, high


def _box(surface: WallSurface, plan: SceneGraph, span: tuple[float, float]) -> Array:
    """(12, 3, 3) triangles from a stretch of a surface, as in its parts, to the middle of the wall."""
    low = next((floor.elevation for floor in plan.floors if floor.id == surface.floor), None) or 0.0
    height = surface.height or (low, low + HEIGHT)
    n, left = np.array(surface.normal), np.array([-surface.normal[1], surface.normal[0]])
    front = np.array(surface.centroid) + np.outer(span, left)
    back = front - _depth(surface, front, plan) * n
    corners = np.array([[*xy, z] for z in height for xy in (*front, *back)])
    return np.asarray(corners[_FACES])


# of a box with the corners front, front, back, back below, and the same above
_FACES = np.array([
    [0, 1, 5], [0, 5, 4], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5], [0, 1, 3], [0, 3, 2],
    [4, 5, 7], [4, 7, 6],
])  # fmt: skip


def _depth(surface: WallSurface, front: Array, plan: SceneGraph) -> float:
    """Metres to the middle of the wall: half of what lies between a stretch with the ends `front` (2, 2) and the next
    surface that faces away behind it."""
    n, middle = np.array(surface.normal), front.mean(axis=0)
    along = (front[1] - front[0]) / np.linalg.norm(front[1] - front[0])
    nearest = THICKEST
    for other in plan.wall_surfaces:
        behind = float((middle - other.centroid) @ n)
        if 0 < behind < nearest and other.floor == surface.floor and n @ other.normal < -PARALLEL:
            reach = np.array(other.ends()) @ along
            beside = (front @ along)[[0, 1]]
            if min(reach.max(), beside[1]) > max(reach.min(), beside[0]):
                nearest = behind
    return nearest / 2 if nearest < THICKEST else SHEET


def _sheet(level: LevelSurface) -> Array:
    """(M, 3, 3) triangles of a floor or a ceiling."""
    area = shapely.make_valid(shapely.Polygon(level.polygon, level.holes))
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(area)).reshape(-1, 4, 2)[:, :3]
    z = [[level.height(x, y) for x, y in triangle] for triangle in corners.tolist()]
    return np.concatenate([corners, np.reshape(z, (-1, 3, 1))], axis=2)
