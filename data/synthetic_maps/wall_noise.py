"""What a LiDAR maps of walls, and to which map room each surface is assigned.

Which walls are observed, and how accurately: the deviations of ends, offset and tilt, and the shortest wall, are those
that the authors of the published matcher fitted to three real scans (48 walls). Missing walls, walls in two pieces and
clutter are this project's assumptions. Rooms are right, or some are merged or split, and surfaces lose their room.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph.segments import Segments
from data.synthetic_maps.exploration import Index, Storey, Walk

SIGMA_END = 0.346  # m along the wall, of each end
SIGMA_ACROSS = 0.061  # m
SIGMA_TILT = float(np.radians(0.15))
SHORTEST = 0.35  # m; shorter walls are not observed
WIDEST_GAP = 0.6  # m between two pieces
MOST_HIDDEN = 0.6  # of a wall whose end is hidden
LONGEST_CLUTTER = 3.0  # m
BEFORE_WALL = 0.3  # m: least depth of a cupboard
SIGMA_SKEW = float(np.radians(2.0))  # of clutter, to the walls
DOOR_MISSING = 0.1  # of the doors
LEAST_CUT = 2.0  # m; shorter rooms are not split


@dataclass(frozen=True)
class NoiseLevels:
    """How noisy a map is beside the project's noise models, which are the defaults.

    `sigma` multiplies all standard deviations, drift included. `missing`, `in_pieces` and `cut_short` are shares of the
    walls: not seen, in two pieces, or with one end hidden; `clutter` are surfaces for each wall. `altered` is the share
    of rooms that `mis_segmented` merges or splits, `astray` that of the surfaces whose room it loses.
    """

    sigma: float = 1.0
    missing: float = 0.1
    in_pieces: float = 0.1  # of the walls that are long enough
    cut_short: float = 0.0
    clutter: float = 0.1
    altered: float = 0.1
    astray: float = 0.1


USUAL = NoiseLevels()


@dataclass(frozen=True, eq=False)
class ObservedWalls(Segments):
    """N surfaces in the A-graph's frame, before the map's own motion. Map rooms are 0, 1, ..."""

    wall: Index  # (N,) into the storey's walls, -1 for clutter
    room: Index  # (N,) into the storey's rooms: where it was seen from
    home: Index  # (N,) the map room, -1 for none

    def __len__(self) -> int:
        return len(self.wall)

    def _columns(self) -> tuple[Any, ...]:
        return self.centre, self.heading, self.half, self.wall, self.room, self.home

    def at(self, chosen: Index | NDArray[np.bool_]) -> "ObservedWalls":
        """Returns the surfaces with these indices."""
        return ObservedWalls(*(column[chosen] for column in self._columns()))


def joined(*parts: ObservedWalls) -> ObservedWalls:
    """Concatenates parts, at least one."""
    return ObservedWalls(*map(np.concatenate, zip(*(part._columns() for part in parts), strict=True)))


def observe_walls(storey: Storey, walked: Walk, rng: np.random.Generator, levels: NoiseLevels = USUAL) -> ObservedWalls:
    """Draws the surfaces that a robot maps on a walk, including clutter."""
    walls = np.concatenate([storey.walls_of[k] for k in walked.rooms])
    clutter = _clutter(storey, walls[rng.random(len(walls)) < levels.clutter], rng)
    walls = walls[rng.random(len(walls)) >= levels.missing]
    length = storey.length[walls]
    cut = (rng.random(len(walls)) < levels.in_pieces) & (length > 2 * SHORTEST + 0.2)
    gap = np.minimum(rng.uniform(0.1, WIDEST_GAP, len(walls)), length - 2 * SHORTEST)
    sigma = levels.sigma * SIGMA_END
    low, high = -length / 2 + rng.normal(0, sigma, len(walls)), length / 2 + rng.normal(0, sigma, len(walls))
    if levels.cut_short:
        hidden = (rng.random(len(walls)) < levels.cut_short) * rng.uniform(0, MOST_HIDDEN, len(walls)) * length
        first = rng.random(len(walls)) < 0.5
        low, high = np.where(first, low + hidden, low), np.where(first, high, high - hidden)
    middle = rng.uniform(-0.5, 0.5, len(walls)) * (length - gap - 2 * SHORTEST)
    last = walls[cut], (middle + gap / 2)[cut], high[cut]
    high = np.where(cut, middle - gap / 2, high)
    unknown = np.isnan(length)  # only the middle slides
    slide = rng.normal(0, sigma / np.sqrt(2), len(walls))
    low, high = np.where(unknown, slide, low), np.where(unknown, slide, high)
    walls, low, high = (np.concatenate(c) for c in zip((walls, low, high), last, strict=True))
    return as_entered(joined(_observed(storey, walls, low, high, levels.sigma, rng), clutter), walked)


def _observed(
    storey: Storey, wall: Index, low: Array, high: Array, factor: float, rng: np.random.Generator
) -> ObservedWalls:
    """Parts of walls from `low` to `high` along their tangents, shifted across and tilted."""
    unknown = np.isnan(storey.half[wall])
    kept = unknown | (high - low >= SHORTEST)
    wall, low, high, unknown = wall[kept], low[kept], high[kept], unknown[kept]
    across = rng.normal(0, factor * SIGMA_ACROSS, len(wall))
    centre = storey.centre[wall] + ((low + high) / 2)[:, None] * storey.tangent[wall]
    centre += across[:, None] * storey.normal[wall]
    heading = storey.heading[wall] + rng.normal(0, factor * SIGMA_TILT, len(wall))
    room = storey.room[wall]
    return ObservedWalls(centre, heading, np.where(unknown, np.nan, high - low) / 2, wall, room, room)


def _clutter(storey: Storey, behind: Index, rng: np.random.Generator) -> ObservedWalls:
    """Vertical planes in front of walls, inside the room, roughly parallel or perpendicular to the wall."""
    n = len(behind)
    room = storey.room[behind]
    wall = np.nan_to_num(storey.length[behind], nan=2.0)
    depth = BEFORE_WALL + rng.exponential(0.6, n)
    aside = rng.uniform(-0.5, 0.5, n) * wall
    centre = storey.centre[behind] + depth[:, None] * storey.normal[behind] + aside[:, None] * storey.tangent[behind]
    quarter = np.where(rng.random(n) < 0.7, 0, rng.integers(1, 4, n)) * np.pi / 2
    heading = se2.wrap(storey.heading[behind] + quarter + rng.normal(0, SIGMA_SKEW, n))
    half = rng.uniform(SHORTEST, LONGEST_CLUTTER, n) / 2
    return _within(storey, ObservedWalls(centre, heading, half, np.full(n, -1), room, room))


def _within(storey: Storey, found: ObservedWalls) -> ObservedWalls:
    """Moves and shortens surfaces until they lie in their room, and drops those that never do.

    Without a footprint, the box of the room's walls is used.
    """
    standing = np.zeros(len(found), dtype=bool)
    for _ in range(4):
        for n, (room, c, arm) in enumerate(zip(found.room.tolist(), found.centre, found.arm, strict=True)):
            standing[n] |= storey.holds(room, np.array([c - arm, c, c + arm]))
        pull = np.where(standing, 0.0, 0.3)
        found = replace(
            found,
            centre=found.centre + pull[:, None] * (storey.middle[found.room] - found.centre),
            half=np.where(standing, found.length, np.maximum(0.6 * found.length, SHORTEST)) / 2,
        )
    return found.at(standing)


@dataclass(frozen=True)
class Passage:
    """A door between two map rooms, at `place` (2,) in the A-graph's frame, mapped with A room `seen_from`."""

    rooms: tuple[int, int]
    place: Array
    seen_from: int

    def moved(self, old: int, new: int) -> "Passage":
        """The door of the room `new`, where it was of `old`."""
        first, last = (new if room == old else room for room in self.rooms)
        return replace(self, rooms=(first, last))


def as_entered(seen: ObservedWalls, walked: Walk) -> ObservedWalls:
    """Assigns every surface to the room it was seen from; map rooms are numbered in order of entry."""
    place = {r: n for n, r in enumerate(walked.rooms)}
    return replace(seen, home=np.array([place[r] for r in seen.room.tolist()], dtype=np.int64))


def passages(storey: Storey, walked: Walk) -> list[Passage]:
    """All doors between the rooms of a walk."""
    place = {r: n for n, r in enumerate(walked.rooms)}
    joined = [(i, j, at) for i, j, at in storey.doors if i in place and j in place]
    return [Passage((place[i], place[j]), at, i if place[i] < place[j] else j) for i, j, at in joined]


def mis_segmented(
    seen: ObservedWalls, doors: list[Passage], walked: Walk, rng: np.random.Generator, levels: NoiseLevels = USUAL
) -> tuple[ObservedWalls, list[Passage]]:
    """Merges rooms with a neighbour or splits them, each at most once; some surfaces lose their room."""
    count = len(walked.rooms)
    altered: set[int] = set()
    for n in np.flatnonzero(rng.random(count) < levels.altered).tolist():
        # the rooms entered from this one, and the one it was entered from
        near = [k for k, p in enumerate(walked.parents) if p == n] + [p for p in walked.parents[n : n + 1] if p >= 0]
        near = [k for k in near if k not in altered]
        if n in altered:
            continue
        if near and rng.random() < 0.5:
            other = near[int(rng.integers(len(near)))]
            seen = replace(seen, home=np.where(seen.home == other, n, seen.home))
            doors = [door for door in (door.moved(other, n) for door in doors) if door.rooms != (n, n)]
            altered |= {n, other}
        else:
            seen, doors = _cut(seen, doors, n, count, rng)
            count += 1
            altered.add(n)
    return replace(seen, home=np.where(rng.random(len(seen)) < levels.astray, -1, seen.home)), doors


def true_rooms(seen: ObservedWalls) -> dict[int, int]:
    """Maps each map room to the A room from which most of its walls, by length, were seen."""
    found = {}
    length = np.nan_to_num(seen.length, nan=1.0)
    for home in np.unique(seen.home[seen.home >= 0]).tolist():
        mine = (seen.home == home) & (seen.wall >= 0)
        if mine.any():
            found[home] = int(np.bincount(seen.room[mine], length[mine]).argmax())
    return found


def _cut(
    seen: ObservedWalls, doors: list[Passage], room: int, new: int, rng: np.random.Generator
) -> tuple[ObservedWalls, list[Passage]]:
    """Splits the room across its longer side; walls that cross the line are cut."""
    part = seen.at(seen.home == room)
    if len(part) < 2:
        return seen, doors
    ends = np.concatenate((part.centre + part.arm, part.centre - part.arm))
    grid = float(part.heading[np.nan_to_num(part.length).argmax()])
    turned = se2.rotate(-grid, ends)
    axis = int(np.ptp(turned, axis=0).argmax())
    low, high = turned[:, axis].min(), turned[:, axis].max()
    if high - low < LEAST_CUT:
        return seen, doors
    at = low + rng.uniform(0.35, 0.65) * (high - low)
    along, middle = se2.rotate(grid, np.eye(2)[axis]), turned.mean(axis=0)
    middle[axis] = at
    between = Passage((room, new), se2.rotate(grid, middle), int(np.bincount(part.room).argmax()))
    first, last = _side(part, along, -at), _side(part, -along, at)
    seen = joined(seen.at(seen.home != room), first, replace(last, home=np.full(len(last), new)))
    return seen, [*(door.moved(room, new) if along @ door.place > at else door for door in doors), between]


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
    return replace(part, centre=(first + last) / 2, half=half).at(kept)
