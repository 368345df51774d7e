"""The walls between the rooms of a plan whose walls stand at right angles: one for each straight wall.

Metres, in a frame whose axes the walls follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.geometry.areas import Area, closed, difference, united
from data.geometry.intervals import common, without
from data.plans.polygons import edges_of, frame_of

PIER, SHAFT = 0.42, 0.85  # m: how far a pier reaches into a room, and the longest side of a shaft in its corner
LEAST = 0.02, 0.35  # m long, of a wall between rooms and of an outer one: more than an inner wall is thick
LONGEST = 12.0  # m: a longer one is built in pieces
TILT = 0.01  # m between the ends of a side, across it
IN_LINE = 0.002  # m: between the faces of walls that are one
SLIVER = 1e-3  # m2


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

    def shifted(self, across: float) -> "StraightWall":
        """The wall, so many metres farther across."""
        return replace(self, near=self.near + across, far=self.far + across)

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


def without_features(room: Area) -> Area:
    """A room without the piers at its walls and the shafts in its corners, in whole millimetres."""
    ring, k = np.asarray(orient(room).exterior.coords)[:-1], 0
    while k < len(ring):
        corners = np.roll(ring, -k, axis=0)
        steps = np.roll(corners, -1, axis=0) - corners
        lengths, (x, y), (x0, y0) = np.hypot(*steps.T), steps.T, np.roll(steps, 1, axis=0).T
        is_reflex = (x0 * y - y0 * x < 0)[:3].tolist()
        if is_reflex[1:] == [True, True] and max(lengths[0], lengths[2]) < PIER and lengths[1] < SHAFT:
            ring, k = corners[4:], 0
        elif is_reflex == [False, True, False] and max(lengths[:2]) < SHAFT:
            ring, k = np.concatenate([[corners[0] + corners[2] - corners[1]], corners[3:]]), 0
        else:
            k += 1
    return _squared(shapely.Polygon(ring).simplify(TILT))


def _squared(room: Area) -> Area:
    """The room with sides along the axes, in whole millimetres."""
    ring = np.asarray(room.exterior.coords)[:-1]
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
