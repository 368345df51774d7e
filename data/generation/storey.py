"""A storey of a generated building: cells that tile its outline become rooms between walls, with doors.

Metres, in the building's own frame until it is moved.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, closed, largest, opened, overlap, polygons_of
from data.plans.polygons import Points, edges_of, frame_of, rooms_behind, tidied
from data.scene_graph.nodes import Xy, xy_of

DOOR = 0.9  # m, with its frame
DOOR_CLEAR = 0.9  # m: nothing stands closer to the middle of a door
MIN_ROOM = 1.2  # m2
SLIVER = 0.2  # m: no part of a room is narrower
HALLS = ("corridor", "hall", "stairs")
Rng = np.random.Generator


@dataclass(frozen=True)
class Cell:
    """A part of the storey up to the middle lines of its walls."""

    area: Area
    kind: str = "room"


def is_rectangle(cell: Cell) -> bool:
    """Whether it is one along the axes."""
    x0, y0, x1, y1 = cell.area.bounds
    return bool(cell.area.area > 0.999 * (x1 - x0) * (y1 - y0))


@dataclass(frozen=True)
class Walls:
    """Thickness of the walls between rooms, along corridors, and outside."""

    inner: float
    corridor: float
    outer: float

    @staticmethod
    def drawn(rng: Rng) -> "Walls":
        """Draws thicknesses as in real buildings."""
        inner = float(rng.choice([0.1, 0.115, 0.12, 0.15, 0.175, 0.2]))
        outer = float(rng.choice([0.24, 0.3, 0.36, 0.4]))
        return Walls(inner, max(inner, float(rng.choice([0.12, 0.15, 0.2, 0.24]))), outer)


PlacedDoor = tuple[Xy, tuple[int, ...]]  # its middle and the rooms that it joins


@dataclass(frozen=True)
class Storey:
    """Rooms as polygons (holes are pillars) with their kinds; doors by their middle and the rooms they join."""

    rooms: tuple[Area, ...]
    kinds: tuple[str, ...]
    doors: tuple[PlacedDoor, ...] = ()

    def moved(self, linear: NDArray[np.float64], offset: Sequence[float]) -> "Storey":
        """Returns the storey under p -> linear p + offset; `linear` is (2, 2)."""

        def move(points: Points) -> Points:
            return points @ linear.T + np.asarray(offset)

        doors = tuple((xy_of(move(np.array(at))), rooms) for at, rooms in self.doors)
        return Storey(tuple(shapely.transform(r, move) for r in self.rooms), self.kinds, doors)

    def joined(self, other: "Storey") -> "Storey":
        """Joins both storeys side by side."""
        n = len(self.rooms)
        theirs = tuple((at, tuple(n + k for k in rooms)) for at, rooms in other.doors)
        return Storey(self.rooms + other.rooms, self.kinds + other.kinds, self.doors + theirs)


def built(cells: Sequence[Cell], walls: Walls, rng: Rng) -> Storey:
    """Returns rooms half a wall inside their cells and a whole outer wall inside the outline; every room has a door."""
    outline = closed(shapely.union_all([c.area for c in cells]), 0.02)  # no hairline between cells
    # Where skewed walls meet at a sharp angle the buffer may cross itself.
    inside = polygons_of(outline.buffer(-walls.outer, join_style="mitre"))
    rooms, kinds = [], []
    for cell in cells:
        half = (walls.corridor if cell.kind in HALLS else walls.inner) / 2
        area = largest(opened(overlap(cell.area.buffer(-half, join_style="mitre"), inside), SLIVER / 2))
        if area.area >= MIN_ROOM and not area.interiors:
            rooms.append(tidied(area))
            kinds.append(cell.kind)
    doors = _doors(rooms, kinds, walls, rng)
    return Storey(tuple(rooms), tuple(kinds), tuple(doors))


def _doors(rooms: list[Area], kinds: list[str], walls: Walls, rng: Rng) -> list[PlacedDoor]:
    """A tree of doors starting from the halls, some more, and one or two from outside."""
    edges = [edges_of(r) for r in rooms]
    gaps = rooms_behind(rooms, edges, max(walls.inner, walls.corridor) + 0.02)
    sites: dict[tuple[int, int], list[tuple[int, float, float]]] = {}  # rooms: edge of the first, from, to along it
    for room, of_edge in gaps.items():
        for k, found in of_edge.items():
            for other, spans in found:
                if wide := [(k, low, high) for low, high in spans if high - low > DOOR + 0.1]:
                    sites.setdefault((room, other), []).extend(wide)

    def between(a: int, b: int) -> PlacedDoor:
        """A door in the wall between two rooms: near an end of the wall, or at its middle."""
        k, low, high = sites[a, b][int(rng.integers(len(sites[a, b])))]
        along, inward, _ = frame_of(edges[a])
        slack = (high - low - DOOR) / 2
        shift = slack * float(rng.choice([-1.0, 0.0, 1.0])) * 0.95 + slack * float(rng.uniform(-0.05, 0.05))
        at = edges[a][k, 0] + along[k] * ((low + high) / 2 + shift)
        gap = shapely.distance(rooms[b], shapely.Point(at))
        return xy_of(at - inward[k] * gap / 2), (a, b)

    order = sorted(range(len(rooms)), key=lambda k: (kinds[k] not in HALLS, -rooms[k].area))
    reached, doors = [order[0]], list[PlacedDoor]()
    for here in reached:  # grows: breadth first, from the halls
        for other in sorted((b for a, b in sites if a == here and b not in reached), key=order.index):
            doors.append(between(here, other))
            reached.append(other)
    tree = {frozenset(joined) for _, joined in doors}
    for a, b in sites:
        if a < b and frozenset((a, b)) not in tree and rng.random() < 0.05:
            doors.append(between(a, b))
    wanted = len(doors) + 1 + int(rng.random() < 0.3)
    for room in order:  # from outside, into the first rooms that have an outer wall
        _, inward, length = frame_of(edges[room])
        free = [k for k in range(len(length)) if k not in gaps.get(room, {}) and length[k] > DOOR + 0.1]
        if free and len(doors) < wanted:
            k = int(rng.choice(free))
            doors.append((xy_of(edges[room][k].mean(axis=0) - inward[k] * walls.outer / 2), (room,)))
    return doors


def furnished(storey: Storey, rng: Rng, share: float) -> Storey:
    """Adds a feature to each room with the probability `share`; large rooms get pillars. Doors stay clear.

    Features lie within the room, so that walls keep their thickness.
    """
    changed = []
    for k, (area, kind) in enumerate(zip(storey.rooms, storey.kinds, strict=True)):
        chance = share * (2.5 if kind in ("bathroom", "wc", "kitchen") else 1.0)
        clear = shapely.MultiPoint([at for at, rooms in storey.doors if k in rooms]).buffer(DOOR_CLEAR)
        if area.area > 60 and kind not in HALLS and rng.random() < 0.6:
            area = _with_pillars(area, clear, rng)
        elif rng.random() < chance:
            part = _standing(area, rng, shaft=rng.random() < 0.5)
            rest = shapely.difference(area, part)
            area = area if part.intersects(clear) or not _is_whole(rest) else rest
        changed.append(area)
    return replace(storey, rooms=tuple(changed))


def _is_whole(room: Area) -> bool:
    """Whether it is not divided, has no sliver, and no short edge."""
    narrow = room.buffer(-0.3, join_style="mitre")
    whole = room.geom_type == "Polygon" and narrow.geom_type == "Polygon" and not narrow.is_empty
    return whole and frame_of(edges_of(room))[2].min() > 0.06 and not room.interiors


def _standing(area: Area, rng: Rng, shaft: bool) -> Area:
    """A shaft in a corner, or a pier or a niche's side at a wall; it reaches a little over the wall, and over the
    corner where it stands in one."""
    edges = edges_of(area)
    along, inward, length = frame_of(edges)
    k = int(rng.choice(len(length), p=length / length.sum()))
    width, depth = float(rng.uniform(0.25, 0.8)), float(rng.uniform(0.15, 0.6))
    start = 0.0
    if not shaft:
        start, depth = float(rng.uniform(0.2, 0.8)) * max(length[k] - width, 0.0), min(depth, 0.4)
    over = 0.0 if start > 0 else 0.05
    foot = edges[k, 0] + along[k] * (start if start > 0 else -over) - 0.05 * inward[k]
    wide, deep = along[k] * (width + over), inward[k] * (depth + 0.05)
    return shapely.Polygon([foot, foot + wide, foot + wide + deep, foot + deep])


def _with_pillars(area: Area, clear: Area, rng: Rng) -> Area:
    """A grid of square or round pillars, each at least 0.8 m from the walls."""
    step, size = float(rng.uniform(4.5, 8.0)), float(rng.uniform(0.3, 0.6))
    corners = np.asarray(shapely.oriented_envelope(area).exterior.coords)[:4]
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    sides = 8 if rng.random() < 0.3 else 4
    turn = np.pi / sides + 2 * np.pi * np.arange(sides) / sides
    corner = size / (2 * np.cos(np.pi / sides)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    shape = corner @ np.array([u / np.hypot(*u), v / np.hypot(*v)])
    inner, pillars = area.buffer(-0.8 - size), []
    columns, rows = int(np.hypot(*u) / step) + 1, int(np.hypot(*v) / step) + 1
    for i, j in product(range(1, columns), range(1, rows)):
        at = corners[0] + u * i / columns + v * j / rows
        if inner.contains(shapely.Point(at)) and not clear.contains(shapely.Point(at)):
            pillars.append(shapely.Polygon(at + shape))
    return shapely.difference(area, shapely.union_all(pillars)) if pillars else area
