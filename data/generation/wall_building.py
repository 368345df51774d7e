"""The only storey of a plan as an IFC file: its walls as bodies of their own, with doors, windows and columns.

There is one wall for each straight wall between the rooms, which stand at right angles. Metres, in a frame whose axes
the walls follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.common.errors import UserError
from data.generation.level_building import DOORWAY, LEAF, LINTEL, STOREY, prisms, write_rooms
from data.geometry.areas import Area, closed, difference, united
from data.geometry.intervals import common, without
from data.ifc.writer import IfcWriter, Prism, box, placed
from data.plans.polygons import edges_of, frame_of
from data.scene_graph import SceneGraph

LEAST = 0.02, 0.35  # m long, of a wall between rooms and of an outer one: more than an inner wall is thick
LONGEST = 12.0  # m: a longer one is built in pieces
TILT = 0.01  # m between the ends of a side, across it
IN_LINE = 0.002  # m: between the faces of walls that are one
SLIVER = 1e-3  # m2
Rng = np.random.Generator
Array = NDArray[np.float64]
Opening = tuple[str, float, float]  # Door or Window, its place along the wall, its width
OUTER = (0.24, 0.3, 0.36)  # m, thickness of outer walls
SLAB = 0.3  # m
SILL, HEAD = 0.9, 2.2  # m: a window's lower and upper edge
REVEAL, PANE = 0.12, 0.06  # m: the pane stands so far behind the wall's inner face, and is so thick
HEIGHTS = (2.6, 3.2)  # m, clear
WINDOWS, BAY, GLAZED = (1.0, 1.8), 2.4, 0.85  # m: widths, and the least distance of their middles; share of the bays
COLUMNS, SIDES = (2, 8), (0.25, 0.5)  # fewest and most of a building, fewer where there is no place; m
FREE = 0.6  # of the columns; the others stand in or at walls
LARGE = 15.0  # m2, of a room with free columns
CLEAR = 0.85  # m around columns, but for the wall in or at which one stands
TRIES = 60  # of a place, for each column


@dataclass(frozen=True)
class StraightWall:
    """From `low` to `high` along x (`axis` 0) or y (1), between its faces at `near` and `far` across. An outer wall has
    the building `inward`: 1 where across grows, -1 where it falls; 0 between rooms."""

    axis: int
    low: float
    high: float
    near: float
    far: float
    inward: int = 0

    def box(self, low: float, high: float) -> Area:
        """The area between two places along the wall, as thick as the wall."""
        (x0, y0), (x1, y1) = ((u, v)[:: 1 - 2 * self.axis] for u, v in ((low, self.near), (high, self.far)))
        return shapely.box(x0, y0, x1, y1)

    @property
    def area(self) -> Area:
        """Its footprint."""
        return self.box(self.low, self.high)

    def met(self, low: float, high: float, areas: Sequence[Area]) -> NDArray[np.float64]:
        """(N,) the places along the wall of the corners of what lies in its way between two places."""
        core = replace(self, near=self.near + IN_LINE, far=self.far - IN_LINE).box(low, high)
        parts = shapely.intersection(core, np.array(areas, dtype=object))
        return shapely.get_coordinates(parts[shapely.area(parts) > SLIVER])[:, self.axis]


def straight_walls(rooms: Sequence[Area], outer: float) -> list[StraightWall]:
    """The walls around and between rooms (at most twice `outer` apart); outer ones are `outer` thick. They touch and
    do not overlap: where two cross, the one in the direction with more wall goes on."""
    pieces = _pieces(rooms, outer)
    lengths = [sum(p.high - p.low for p in pieces if p.axis == axis) for axis in (0, 1)]
    walls: list[StraightWall] = []
    for axis in sorted((0, 1), key=lambda axis: -lengths[axis]):
        taken = [*rooms, *(wall.area for wall in walls)]
        walls += _joined([p for p in pieces if p.axis == axis], 2 * outer, taken)
    outline = outline_of(rooms, outer)
    outside = difference(outline.envelope.buffer(2 * outer, join_style="mitre"), outline)
    for k, wall in enumerate(walls):
        others = [other.area for other in walls[:k] + walls[k + 1 :]]
        walls[k] = _fitted(wall, [*rooms, outside, *others], 2 * outer)
    return [wall for wall in walls if wall.high - wall.low > LEAST[0]]


def footprints(walls: Sequence[StraightWall], rooms: Sequence[Area], outer: float) -> list[Area]:
    """The walls' areas in plan, with the corners that no wall reaches added to the wall that they touch most."""
    areas = [wall.area for wall in walls]
    for rest in shapely.get_parts(difference(outline_of(rooms, outer), united([*rooms, *areas]))):
        if not rest.buffer(-2 * IN_LINE).is_empty:
            k = max(range(len(areas)), key=lambda k: rest.buffer(IN_LINE).intersection(areas[k]).area)
            areas[k] = closed(united([areas[k], rest]), 2 * IN_LINE)
    return areas


def outline_of(rooms: Sequence[Area], outer: float) -> Area:
    """The building's footprint, with outer walls of this thickness."""
    return united(rooms).buffer(outer, join_style="mitre")


def squared(room: Area) -> Area:
    """The room with sides along the axes, in whole millimetres."""
    ring = np.asarray(orient(room.simplify(TILT)).exterior.coords)[:-1]
    following = np.roll(ring, -1, axis=0)
    after = ((ring + following) / 2).round(3)  # the middle of the side after each corner
    before = np.roll(after, 1, axis=0)
    is_along_x = np.ptp([ring, following], axis=0).argmax(axis=1) == 0
    # the one of the two sides gives x, the other one y
    return shapely.Polygon(np.where(np.stack([is_along_x, ~is_along_x], axis=1), before, after))


def _pieces(rooms: Sequence[Area], outer: float) -> list[StraightWall]:
    """The walls without what lies between their crossings: of each face of a room, where it faces which other one."""
    faces = [face for room in rooms for face in _faces(room)]
    found = []
    for face in faces:

        def depth(other: StraightWall, face: StraightWall = face) -> float:
            return (face.near - other.near) * face.inward

        opposite = [f for f in faces if (f.axis, f.inward) == (face.axis, -face.inward) and 0 < depth(f) < 2 * outer]
        free = [(face.low, face.high)]
        for other in sorted(opposite, key=depth):
            shared = common(free, [(other.low, other.high)]) if face.inward > 0 else []  # each pair of faces once
            between = replace(face, near=other.near, inward=0)
            found += [replace(between, low=a, high=b) for a, b in shared if b - a > LEAST[0]]
            free = without(free, [(other.low, other.high)])
        near, far = sorted((face.near, face.near - face.inward * outer))
        found += [replace(face, low=a, high=b, near=near, far=far) for a, b in free if b - a > LEAST[1]]
    return found


def _faces(room: Area) -> list[StraightWall]:
    """A room's sides, as walls without thickness."""
    edges = edges_of(room)
    faces = []
    for edge, normal in zip(edges, frame_of(edges)[1].round().astype(int).tolist(), strict=True):
        axis = 1 if normal[0] else 0
        low, high = sorted(edge[:, axis].tolist())
        at = float(edge[0, 1 - axis])
        faces.append(StraightWall(axis, low, high, at, at, normal[1 - axis]))
    return faces


def _joined(pieces: Sequence[StraightWall], gap: float, taken: Sequence[Area]) -> list[StraightWall]:
    """Pieces in one line, joined over gaps that are not taken, up to `LONGEST`."""
    walls: list[StraightWall] = []
    for piece in sorted(pieces, key=lambda p: p.low):
        for k, wall in enumerate(walls):
            in_line = max(abs(wall.near - piece.near), abs(wall.far - piece.far)) < IN_LINE
            is_next = 0 < piece.low - wall.high < gap and piece.high - wall.low < LONGEST
            same = in_line and is_next and wall.inward == piece.inward
            if same and not len(wall.met(wall.high, piece.low, taken)):
                walls[k] = replace(wall, high=piece.high)
                break
        else:
            walls.append(piece)
    return walls


def _fitted(wall: StraightWall, solid: Sequence[Area], reach: float) -> StraightWall:
    """The wall, from its middle to where it meets what is solid, by at most `reach` over its ends."""
    middle = (wall.low + wall.high) / 2
    below, above = wall.met(wall.low - reach, middle, solid), wall.met(middle, wall.high + reach, solid)
    low = float(below.max()) if len(below) else wall.low
    high = float(above.min()) if len(above) else wall.high
    return replace(wall, low=round(low, 3), high=round(high, 3))


def write_wall_building(plan: SceneGraph, path: Path | str, seed: int) -> None:
    """Writes the only storey of a `plain` plan as an IFC file. Raises UserError for a plan of several storeys, or with
    walls that are not at right angles to each other."""
    if len(plan.floors) > 1:
        raise UserError(f"a plan of {len(plan.floors)} storeys; give one of a single storey")
    rng = np.random.default_rng([seed, 67, len(plan.rooms)])
    outer, height, width = (float(rng.choice(OUTER)), *(float(rng.uniform(*limits)) for limits in (HEIGHTS, WINDOWS)))
    T_bim_plan, rooms = _squared_rooms(plan)
    walls = straight_walls(rooms, outer)
    doors = _places(plan, T_bim_plan, walls)
    windows = [_windows(wall, rooms, at, width, rng) for wall, at in zip(walls, doors, strict=True)]
    writer = IfcWriter.begun(f"Walls {seed}", {STOREY: 0.0}, T_bim_plan)
    areas, holes = footprints(walls, rooms, outer), list[Area]()
    for number, (wall, area, at, panes) in enumerate(zip(walls, areas, doors, windows, strict=True), 1):
        openings = [("Door", u, DOORWAY) for u in at] + [("Window", u, width) for u in panes]
        holes += [wall.box(u - wide / 2, u + wide / 2) for _, u, wide in openings]
        _write_wall(writer, f"Wall {number}", wall, area, height, openings)
    for number, column in enumerate(_columns(rooms, walls, holes, rng), 1):
        writer.element("IfcColumn", f"Column {number}", STOREY, prisms(column, 0.0, height), kind="COLUMN")
    write_rooms(writer, rooms, outline_of(rooms, outer), height, SLAB)
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
    return T_bim_plan, [squared(shapely.Polygon((ring - t) @ R)) for ring in rings]


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
    found, aside = [], wall.inward * BAY / 4
    inside = replace(wall, near=wall.near + aside, far=wall.far + aside)
    for room in rooms:
        along = inside.met(wall.low, wall.high, [room])
        if len(along) == 0:
            continue
        low, high = float(along.min()), float(along.max())
        bays = int((high - low) / BAY)
        found += [low + (k + 0.5) * (high - low) / bays for k in range(bays) if rng.random() < GLAZED]
    return [u for u in found if all(abs(u - door) > (width + DOORWAY) / 2 + 0.3 for door in doors)]


def _write_wall(
    writer: IfcWriter, name: str, wall: StraightWall, area: Area, height: float, openings: Sequence[Opening]
) -> None:
    """Writes a wall with this footprint and its openings. Its frame: x along it with the building to its left, y to the
    left."""
    half, middle = (wall.far - wall.near) / 2, (wall.near + wall.far) / 2
    begin, end = (wall.high, wall.low) if wall.inward == (1 if wall.axis else -1) else (wall.low, wall.high)
    x, y = (begin, middle)[:: 1 - 2 * wall.axis]
    along = np.roll([np.sign(end - begin), 0.0], wall.axis)
    T_storey_wall = placed(x, y, yaw=float(np.arctan2(along[1], along[0])))
    relative = np.array(area.exterior.coords)[:-1] - (x, y)
    outline = np.column_stack([relative @ along, relative @ [-along[1], along[0]]]).round(4).tolist()
    prism = Prism(tuple((u, v) for u, v in outline), 0.0, height)
    host = writer.element("IfcWall", name, STOREY, [prism], T_storey_wall, "SOLIDWALL")
    for kind, place, width in openings:
        z0, z1, y0, y1 = 0.0, LINTEL, -LEAF / 2, LEAF / 2
        if kind == "Window":
            z0, z1, y0, y1 = SILL, HEAD, half - REVEAL - PANE, half - REVEAL
        T_storey_hole = T_storey_wall @ placed(abs(place - begin) - width / 2, 0.0)
        body = [box(0.0, y0, z0, width, y1, z1)]
        filling = writer.element(f"Ifc{kind}", f"{kind} in {name}", STOREY, body, T_storey_hole, kind.upper())
        filling.OverallWidth, filling.OverallHeight = width, z1 - z0
        writer.cut(host, STOREY, box(0.0, -half, z0, width, half, z1), T_storey_hole, filling)


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
