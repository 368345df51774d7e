"""Assigns observed surfaces to map rooms: correctly, or with rooms merged, split, and surfaces without a room."""

from dataclasses import dataclass, replace

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.exploration import Index, Storey, Walk
from data.synthetic_maps.wall_noise import SHORTEST, USUAL, NoiseLevels, ObservedWalls, joined

DOOR_MISSING = 0.1
LEAST_CUT = 2.0  # m; shorter rooms are not split


@dataclass(frozen=True)
class Passage:
    """A door between two map rooms, at `place` (2,) in the A-graph's frame, mapped with A room `seen_from`."""

    rooms: tuple[int, int]
    place: Array
    seen_from: int


@dataclass(frozen=True, eq=False)
class MapRooms:
    """The surfaces of a map, the map room of each, -1 for none, and the doors. Map rooms are 0, 1, ..."""

    seen: ObservedWalls
    home: Index  # (N,)
    doors: tuple[Passage, ...]


def rooms_as_entered(storey: Storey, walk: Walk, seen: ObservedWalls) -> MapRooms:
    """Assigns every surface to the room it was seen from, with all doors; map rooms are numbered in order of entry."""
    place = {r: n for n, r in enumerate(walk.rooms)}
    doors = tuple(
        Passage((place[i], place[j]), at, i if place[i] < place[j] else j)
        for i, j, at in storey.doors
        if i in place and j in place
    )
    return MapRooms(seen, np.array([place[r] for r in seen.room.tolist()], dtype=np.int64), doors)


def some_doors_missed(map_rooms: MapRooms, rng: np.random.Generator) -> MapRooms:
    """Drops each door with a probability of 10 %."""
    return replace(map_rooms, doors=tuple(d for d in map_rooms.doors if rng.random() >= DOOR_MISSING))


def mis_segmented(map_rooms: MapRooms, walk: Walk, rng: np.random.Generator, levels: NoiseLevels = USUAL) -> MapRooms:
    """Merges rooms with a neighbour or splits them, each at most once; some surfaces lose their room."""
    count = len(walk.rooms)
    altered: set[int] = set()
    for n in np.flatnonzero(rng.random(count) < levels.altered).tolist():
        near = [k for k in _beside(walk, n) if k not in altered]
        if n in altered:
            continue
        if near and rng.random() < 0.5:
            other = near[int(rng.integers(len(near)))]
            map_rooms = _merged(map_rooms, n, other)
            altered |= {n, other}
        else:
            map_rooms = _cut(map_rooms, n, count, rng)
            count += 1
            altered.add(n)
    home = np.where(rng.random(len(map_rooms.home)) < levels.astray, -1, map_rooms.home)
    return replace(map_rooms, home=home)


def true_rooms(map_rooms: MapRooms) -> dict[int, int]:
    """Maps each map room to the A room from which most of its walls, by length, were seen."""
    found = {}
    length = np.nan_to_num(map_rooms.seen.length, nan=1.0)
    for home in np.unique(map_rooms.home[map_rooms.home >= 0]).tolist():
        mine = (map_rooms.home == home) & (map_rooms.seen.wall >= 0)
        rooms, where = np.unique(map_rooms.seen.room[mine], return_inverse=True)
        if len(rooms):
            found[home] = int(rooms[np.bincount(where, length[mine]).argmax()])
    return found


def _beside(walk: Walk, n: int) -> list[int]:
    """The rooms entered from this one, and the one it was entered from."""
    return [k for k, p in enumerate(walk.parents) if p == n] + ([walk.parents[n]] if walk.parents[n] >= 0 else [])


def _merged(map_rooms: MapRooms, kept: int, gone: int) -> MapRooms:
    doors = []
    for door in map_rooms.doors:
        first, last = (kept if r == gone else r for r in door.rooms)
        if first != last:
            doors.append(replace(door, rooms=(first, last)))
    return MapRooms(map_rooms.seen, np.where(map_rooms.home == gone, kept, map_rooms.home), tuple(doors))


def _cut(map_rooms: MapRooms, room: int, new: int, rng: np.random.Generator) -> MapRooms:
    """Splits the room across its longer side; walls that cross the line are cut."""
    seen, home = map_rooms.seen, map_rooms.home
    mine = np.flatnonzero(home == room)
    if len(mine) < 2:
        return map_rooms
    part = seen.at(mine)
    ends = np.concatenate((part.centre + part.arm, part.centre - part.arm))
    grid = float(part.heading[np.nan_to_num(part.length).argmax()])
    turned = se2.rotate(-grid, ends)
    axis = int(np.ptp(turned, axis=0).argmax())
    low, high = turned[:, axis].min(), turned[:, axis].max()
    if high - low < LEAST_CUT:
        return map_rooms
    at = low + rng.uniform(0.35, 0.65) * (high - low)
    along = se2.rotate(grid, np.eye(2)[axis])
    pieces = [_side(part, along, -at), _side(part, -along, at)]
    rest = np.flatnonzero(home != room)
    homes = [home[rest], np.full(len(pieces[0]), room), np.full(len(pieces[1]), new)]
    middle = turned.mean(axis=0)
    middle[axis] = at
    place = se2.rotate(grid, middle)
    doors = [_after_cut(door, room, new, along, at) for door in map_rooms.doors]
    seen_from = int(np.bincount(part.room).argmax())
    return MapRooms(
        joined([seen.at(rest), *pieces]), np.concatenate(homes), (*doors, Passage((room, new), place, seen_from))
    )


def _after_cut(door: Passage, room: int, new: int, along: Array, at: float) -> Passage:
    beyond = float(along @ door.place) > at
    first, last = (new if r == room and beyond else r for r in door.rooms)
    return replace(door, rooms=(first, last))


def _side(part: ObservedWalls, along: Array, offset: float) -> ObservedWalls:
    """The part with along . p + offset < 0, without pieces shorter than a visible wall."""
    first, last = (part.centre + s * part.arm for s in (1, -1))
    f, g = first @ along + offset, last @ along + offset
    crossed = f * g < 0
    share = np.where(crossed, f / np.where(crossed, f - g, 1.0), 0.0)
    edge = first + share[:, None] * (last - first)
    first, last = (np.where((crossed & (v > 0))[:, None], edge, e) for v, e in ((f, first), (g, last)))
    length = np.hypot(*(first - last).T)
    kept = np.where(crossed, length >= SHORTEST, f + g < 0)
    half = np.where(np.isnan(part.half), np.nan, length) / 2
    return replace(part, centre=(first + last) / 2, half=half).at(np.flatnonzero(kept))
