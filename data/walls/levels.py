"""Level surfaces: the floors and ceilings of rooms, from the level faces of slabs, coverings, roofs, ramps and stairs.

A face belongs to the room from which it is seen. Outside all rooms it is kept where one could be: on the floor of a
storey, and between a floor and a ceiling.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from data.geometry.areas import Area, difference, opened, overlap, polygons_of, united
from data.geometry.level_faces import CLEARANCE, LEAST, Array, LevelFace, Plane, level_faces, visible, within
from data.scene_graph import Floor, LevelSurface
from data.walls.rooms import RoomVolume
from data.walls.solids import Solid

OFF = 0.3  # m by which a room's floor may lie under its space, and its ceiling over it
HEAD = 1.0  # m of a room above a floor, at least
HALF = 0.2  # m: half the width of the narrowest level surface; stairs' treads are narrower
LEAST_BESIDE = 2.0  # m2, outside all rooms
LANDING = 0.9  # of a landing's area lies in one room
TIDY = 0.001  # m: corners that stand out less are no corners
WallsAt = Callable[[Area, float], Area]


@dataclass(frozen=True, eq=False)
class PlannedLevels:
    """The level faces of a plan, its stairs and ramps with their hulls in plan, and the triangles (M, 3, 3) that bound
    the space of a room, by its id, None for none."""

    faces: Sequence[LevelFace]
    stairs: Sequence[tuple[Solid, Area]] = ()
    bounds: Callable[[str], Array | None] = lambda _: None

    def stairs_in(self, area: Area, low: float = np.inf, high: float = -np.inf) -> bool:
        """Whether a stair or ramp in an area begins below one height and ends above another."""
        return any(s.bottom < low and s.top > high and overlap(area, hull).area > LEAST for s, hull in self.stairs)

    def space(self, room: RoomVolume) -> Iterator[LevelFace]:
        """Yields the floor and ceiling of a room's space."""
        bounds = self.bounds(room.room.id)
        for face in () if bounds is None else level_faces(bounds, room.room.id, "IfcSpace"):
            yield replace(face, is_floor=not face.is_floor)


def level_surfaces(
    planned: PlannedLevels, rooms: Sequence[RoomVolume], floors: Sequence[Floor], walls_at: WallsAt
) -> tuple[LevelSurface, ...]:
    """The level surfaces of a building by height, without what is hidden; `walls_at` gives its walls in an area at a
    height.
    """
    shown = sorted(visible(planned.faces), key=lambda f: f.middle)
    found = _Rooms(rooms, planned, shown)
    rest = [found.claim(face) for face in shown]
    rest = [face if face.is_floor else found.claim_above(face) for face in rest]
    for room in rooms:
        found.fill(room)
    surfaces = [s for face, room in found.claims for s in _surfaces(face, room.room.floor, room.room.id)]
    for face in rest:
        if face.area.area > LEAST_BESIDE:
            z = face.middle + OFF if face.is_floor else face.middle - CLEARANCE
            below = [f for f in floors if f.elevation is not None and f.elevation <= z]
            beside = replace(face, area=_beside(face, shown, rooms, below, walls_at))
            surfaces += _surfaces(beside, below[-1].id if below else None, None, LEAST_BESIDE)
    return tuple(replace(s, id=f"level-{k}") for k, s in enumerate(surfaces, 1))


class _Rooms:
    """The rooms from the highest down, and `claims`: which parts of faces are seen from which room."""

    def __init__(self, rooms: Sequence[RoomVolume], planned: PlannedLevels, shown: Sequence[LevelFace]) -> None:
        self._planned, self._shown = planned, shown
        self._rooms = sorted(rooms, key=lambda r: -r.bottom)
        self._tree = shapely.STRtree([r.area for r in self._rooms])
        self._taken: dict[tuple[str, bool], list[Area]] = defaultdict(list)
        self._galleries: dict[str, list[Area]] = defaultdict(list)  # under which a room goes on
        self.claims: list[tuple[LevelFace, RoomVolume]] = []

    def _near(self, area: Area) -> list[RoomVolume]:
        return [self._rooms[k] for k in sorted(self._tree.query(area, predicate="intersects").tolist())]

    def _take(self, face: LevelFace, room: RoomVolume, part: Area) -> LevelFace:
        """The face without a part that is seen from a room."""
        if part.area == 0:
            return face
        self.claims.append((replace(face, area=part), room))
        self._taken[room.room.id, face.is_floor].append(part)
        return replace(face, area=polygons_of(difference(face.area, part)))

    def claim(self, face: LevelFace) -> LevelFace:
        """Gives a face to the rooms in whose spaces it lies, and returns the rest of it.

        A landing may lie above the space of its stairwell. What lies that high without anything above it is a roof.
        """
        for room in self._near(face.area):
            inside = overlap(face.area, room.area)
            if not face.is_floor:
                part = within(inside, face.plane, room.bottom + CLEARANCE, room.top + OFF)
            else:
                is_landing = inside.area > LANDING * face.area.area and self._planned.stairs_in(room.area)
                high = np.inf if is_landing else room.top - HEAD
                part = within(inside, face.plane, room.bottom - OFF, high)
                if part.area > 0 and face.middle > room.bottom + CLEARANCE:
                    part = polygons_of(overlap(part, _facing(face, self._shown)))
                    self._galleries[room.room.id].append(part)
            face = self._take(face, room, part)
        return face

    def claim_above(self, ceiling: LevelFace) -> LevelFace:
        """Gives a ceiling to the rooms under it that have none yet, or only a gallery: their spaces end short of it."""
        for room in self._near(ceiling.area):
            open_above = united([self._bare(room, is_floor=False), *self._galleries[room.room.id]])
            over = within(overlap(ceiling.area, open_above), ceiling.plane, room.bottom + CLEARANCE, np.inf)
            ceiling = self._take(ceiling, room, over)
        return ceiling

    def _bare(self, room: RoomVolume, is_floor: bool) -> Area:
        """The part of a room that has no floor or ceiling yet."""
        return polygons_of(difference(room.area, united(self._taken[room.room.id, is_floor])))

    def fill(self, room: RoomVolume) -> None:
        """Takes the faces of a room's space as its floor and ceiling, if it has hardly any and no stair leads there."""
        lacking = {k: bare for k in (True, False) if (bare := self._bare(room, k)).area > room.area.area / 2}
        for face in self._planned.space(room) if lacking else ():
            bare = lacking.get(face.is_floor)
            if bare is not None and not self._planned.stairs_in(bare, face.middle - 2 * OFF, face.middle - OFF):
                self._take(face, room, polygons_of(overlap(face.area, bare)))


def _beside(
    face: LevelFace,
    shown: Sequence[LevelFace],
    rooms: Sequence[RoomVolume],
    below: Sequence[Floor],
    walls_at: WallsAt,
) -> Area:
    """The part of a face beside all rooms and walls that is the floor of a storey not above it, or between floor and
    ceiling."""
    z, side = face.middle, 1.0 if face.is_floor else -1.0
    near = (r for r in rooms if r.bottom - CLEARANCE < z < r.top + CLEARANCE and r.area.intersects(face.area))
    free = polygons_of(difference(face.area, united(r.area for r in near)))
    if free.area < LEAST_BESIDE:
        return free
    free = polygons_of(difference(free, walls_at(free, z + side * HEAD / 2)))
    if face.is_floor and below and z - (below[-1].elevation or 0.0) < OFF:
        return free
    return polygons_of(overlap(free, _facing(face, shown)))


def _facing(face: LevelFace, others: Sequence[LevelFace]) -> Area:
    """Where a ceiling is above a floor, or a floor below a ceiling."""
    side = 1.0 if face.is_floor else -1.0
    facing = (f for f in others if f.is_floor != face.is_floor and side * (f.middle - face.middle) > CLEARANCE)
    return united(f.area for f in facing if f.area.intersects(face.area))


def _surfaces(face: LevelFace, floor: str | None, room: str | None, least: float = LEAST) -> Iterator[LevelSurface]:
    """One for each polygon of a face that is as large as a level, with empty ids."""
    for part in shapely.get_parts(face.area):
        if part.area < least or opened(part, HALF).is_empty:
            continue
        tidy = orient(shapely.simplify(part, TIDY))
        outer, *holes = (tuple(ring.coords[:-1]) for ring in (tidy.exterior, *tidy.interiors))
        plane, stated = normal_form(face.plane, face.is_floor), face.kind != "IfcSpace"
        yield LevelSurface("", plane, outer, tuple(holes), room, floor, face.source, face.kind, stated)


def normal_form(plane: Plane, is_floor: bool) -> tuple[float, float, float, float]:
    """The plane of a level surface as in `LevelSurface`."""
    a, b, c = plane
    n = np.array([-b, -c, 1.0, -a]) / np.sqrt(1 + b * b + c * c) * (1.0 if is_floor else -1.0)
    nx, ny, nz, d = (n + 0.0).tolist()
    return nx, ny, nz, d
