"""Rooms as the closed faces between walls; their doors; where one could be outside of them."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from data.geometry.areas import Area, difference, enclosed, opened, overlap, united
from data.scene_graph import Door, Room
from data.walls.edges import OPENING_WIDTH, ends_of, is_pillar, straightened

GAP = 0.3  # m: walls this close to each other meet
DOORWAY = 1.6  # m: a wider gap between walls, or opening under a lintel, joins what lies on its sides
PASSABLE = 0.5  # m: a narrower gap between walls is no door
PASSAGE = 0.3  # m: half the width of the narrowest place where one could be
JAMB = 0.7  # m: no wall's end is wider
MIN_AREA = 1.5  # m2: below it, a shaft
MIN_OPEN = 2.0  # m2: a smaller open area is a shaft
AROUND = 2.0  # m around the building: the width of what is open there
STOREY = 2.2  # m: no storey is lower
BESIDE = 0.1  # m: a doorway's rooms begin this close to it


@dataclass(frozen=True)
class RoomVolume:
    """A room with its `area` in plan (a polygon, maybe with holes) from `bottom` to `top`, BIM frame."""

    room: Room
    area: Area
    bottom: float
    top: float

    def beside(self, other: "RoomVolume") -> bool:
        """Whether both rooms share at least half of the lower one's height: on one level."""
        shared = min(self.top, other.top) - max(self.bottom, other.bottom)
        return shared > 0.5 * min(self.top - self.bottom, other.top - other.bottom)


@dataclass(frozen=True)
class Level:
    """Rooms whose floors lie at one height, and the `open` area outside all rooms, whose walls face no room.

    `own` names the walls that may face it (None: all may).
    """

    floor: str | None
    bottom: float
    top: float
    rooms: tuple[RoomVolume, ...] = ()
    open: Area = field(default_factory=shapely.Polygon)
    own: frozenset[str] | None = None


def outlined(room: Room, area: Area) -> Room:
    """The room with the outer ring of an area, and that ring's centroid."""
    outer = shapely.Polygon(area.exterior)
    polygon = tuple((float(x), float(y)) for x, y in outer.exterior.coords[:-1])
    return replace(room, centroid=(float(outer.centroid.x), float(outer.centroid.y)), polygon=polygon)


def finished(volume: RoomVolume) -> RoomVolume:
    """Returns the room with polygon and centroid from its area."""
    return replace(volume, room=outlined(volume.room, volume.area))


def rooms_of_faces(
    faces: Iterable[Area], key: str, floor: str | None, bottom: float, top: float
) -> tuple[RoomVolume, ...]:
    """The faces as rooms between two heights; their ids are `key` and a number by position."""
    rooms = (Room(f"{key}/room-{k}", (0.0, 0.0), floor, f"Room {k}") for k in itertools.count(1))
    return tuple(finished(RoomVolume(room, face, bottom, top)) for face, room in zip(faces, rooms, strict=False))


def doorways(openings: Area) -> list[Area]:
    """The openings under a lintel that are no wider than a doorway."""
    return [part for part in shapely.get_parts(openings) if part.area > 0 and width_of(part) <= DOORWAY]


def open_area(walls: Area, rooms: Iterable[Area]) -> Area:
    """Where one could be outside all rooms, around the building as well; `walls` may have their openings closed."""
    taken = united([walls, *rooms])
    if taken.is_empty:
        return taken
    free = opened(difference(taken.envelope.buffer(AROUND, join_style="mitre"), taken), PASSAGE)
    return shapely.MultiPolygon([p for p in shapely.get_parts(free) if p.area > MIN_OPEN])


def closed_faces(walls: Area) -> list[Area]:
    """The closed faces between walls in which one could be, by position."""
    faces = [f for f in enclosed(walls) if f.area >= MIN_AREA and opened(f, PASSAGE).area >= MIN_AREA]
    return sorted(faces, key=lambda f: (round(f.centroid.x, 2), round(f.centroid.y, 2)))


def halls(walls: Area, faces: list[Area]) -> tuple[list[Area], list[Area]]:
    """The faces outside the given ones that are closed but for gaps of a gate's width, and these gaps."""
    parts = shapely.get_parts(straightened(walls))
    gates = list(gaps(shapely.MultiPolygon([p for p in parts if not is_pillar(p)]), OPENING_WIDTH))
    inside = united(faces)
    found = closed_faces(united([walls, *gates])) if gates else []
    gained = [f for f in found if overlap(f, inside).area < f.area / 2]
    return gained, [g for g in gates if any(f.distance(g) < GAP for f in gained)]


def gaps(walls: Area, widest: float) -> Iterable[Area]:
    """The gaps before walls' ends that another wall closes within `widest` metres."""
    edges = ends_of(walls, JAMB)
    if not edges:
        return
    middles = np.array([e.point(e.length / 2) for e in edges])
    normals = np.array([e.normal for e in edges])
    sights = shapely.linestrings(np.stack([middles + 0.01 * normals, middles + widest * normals], axis=1))
    met = shapely.intersection(sights, walls)
    between = shapely.distance(shapely.points(middles), met)
    for edge, gap in zip(edges, between.tolist(), strict=True):
        if PASSABLE <= gap <= widest:
            a, b = edge.start, edge.point(edge.length)
            yield shapely.Polygon([a, b, b + (gap + 0.01) * edge.normal, a + (gap + 0.01) * edge.normal])


def doors_of(key: str, openings: Iterable[Area], rooms: Sequence[RoomVolume]) -> Iterable[Door]:
    """The openings with a room on one side or two."""
    for number, opening in enumerate(openings, 1):
        beside = [r.room.id for r in rooms if r.area.distance(opening) < BESIDE]
        if 1 <= len(beside) <= 2:
            middle = float(opening.centroid.x), float(opening.centroid.y)
            yield Door(f"{key}/door-{number}", tuple(beside), middle, width_of(opening))


def width_of(opening: Area) -> float:
    """The longer side (m) of an opening, which is drawn from one side of its wall to the other."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(opening))
    return float(np.hypot(*np.diff(corners, axis=0).T).max(initial=0.0))
