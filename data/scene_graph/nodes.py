"""The nodes of a scene graph: floors, rooms, wall surfaces, level surfaces, doors and keyframes.

Lengths are in metres, angles in radians, coordinates in the graph's frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

FARTHEST = 1e9  # m: no coordinate on the earth is larger, and squares of it stay exact enough
Number = Annotated[float, Field(strict=True, ge=-FARTHEST, le=FARTHEST)]  # no text and no truth value in JSON
Xy = tuple[Number, Number]
WALL_HEIGHT = 2.5  # m, of a wall whose height is unknown


def xy_of(point: Sequence[float] | NDArray[np.float64]) -> Xy:
    """The first two coordinates of a point."""
    return float(point[0]), float(point[1])


@dataclass(frozen=True)
class Floor:
    """A storey. `elevation` is the z of its finished floor in metres, None if unknown."""

    id: str
    name: str = ""
    elevation: Number | None = None


@dataclass(frozen=True)
class Room:
    """A room or corridor.

    Attributes:
        id: Unique within the graph.
        centroid: (x, y) in metres.
        floor: Id of the floor, None if unknown.
        name: The name in the plan.
        polygon: Outer ring of the footprint as (x, y) in metres, without repeating the first corner; None if unknown.
    """

    id: str
    centroid: Xy
    floor: str | None = None
    name: str = ""
    polygon: tuple[Xy, ...] | None = None


@dataclass(frozen=True)
class WallSurface:
    """One side of a wall.

    Attributes:
        id: Unique within the graph.
        room: Id of the room that the surface faces, None if unknown.
        centroid: (x, y) of the footprint's mid point in metres.
        normal: (x, y) unit vector into the room.
        length: Length of the footprint in metres, None if unknown.
        floor: Id of the floor, None if unknown.
        source: What the surface was read from, for example the wall's GlobalId in the IFC file.
        height: z of the lower and the upper edge in metres: in the BIM frame for a plan, above the floor for a map.
        plane: (nx, ny, nz, d) with n.x + d = 0, None if unknown.
        parts: Where which wall stands along a planned surface: (source, from, to, whether full-height rather than below
            a window). Positions are metres from the mid point, to the left when looking along the normal. The gaps
            between parts are doors and other openings.
    """

    id: str
    room: str | None
    centroid: Xy
    normal: Xy
    length: Number | None = None
    floor: str | None = None
    source: str = ""
    height: tuple[Number, Number] | None = None
    plane: tuple[Number, Number, Number, Number] | None = None
    parts: tuple[tuple[str, Number, Number, Annotated[bool, Field(strict=True)]], ...] = ()

    def ends(self) -> tuple[Xy, Xy]:
        """Returns both end points (x, y) of the footprint, the left one (looking along the normal) first."""
        half = (self.length or 0.0) / 2
        (cx, cy), (nx, ny) = self.centroid, self.normal
        return (cx - ny * half, cy + nx * half), (cx + ny * half, cy - nx * half)


@dataclass(frozen=True)
class LevelSurface:
    """A planned floor or ceiling of a room, as far as it can be seen from there: level, or a slope of at most 15
    degrees. Those of one `source` and plane are parts of one surface.

    Attributes:
        id: Unique within the graph.
        plane: (nx, ny, nz, d) with n.x + d = 0; n points up from a floor, down from a ceiling.
        polygon: Outer ring of the visible part in plan view as (x, y) in metres, without repeating the first corner.
        holes: Its inner rings likewise.
        room: Id of the room over the floor or under the ceiling, None outside all rooms.
        floor: Id of the storey, None if unknown.
        source: What the surface was read from, for example the slab's GlobalId in the IFC file.
        kind: The class of its source, for example `IfcCovering`; empty if unknown.
        stated: Whether the plan has the surface itself or its height; False for one that only bounds a space.
    """

    id: str
    plane: tuple[Number, Number, Number, Number]
    polygon: tuple[Xy, ...]
    holes: tuple[tuple[Xy, ...], ...] = ()
    room: str | None = None
    floor: str | None = None
    source: str = ""
    kind: str = ""
    stated: Annotated[bool, Field(strict=True)] = True

    @property
    def is_floor(self) -> bool:
        """Whether it is seen from above."""
        return self.plane[2] > 0

    def height(self, x: float, y: float) -> float:
        """Returns the z of the surface's plane at (x, y), all in metres."""
        nx, ny, nz, d = self.plane
        return -(nx * x + ny * y + d) / nz


@dataclass(frozen=True)
class Door:
    """A door or passage. `rooms` holds the ids of the rooms it joins (one for an outer door), `centroid` is (x, y) and
    `width` its width, both in metres; None where it is unknown.
    """

    id: str
    rooms: tuple[str, ...]
    centroid: Xy
    width: Number | None = None


@dataclass(frozen=True)
class Keyframe:
    """A pose of the sensor in the map.

    Attributes:
        id: Unique within the graph.
        stamp_ns: Time in nanoseconds.
        pose: T_map_sensor as (x, y, z, qx, qy, qz, qw); metres and a unit quaternion.
        floor: Id of the floor, None if unknown.
        room: Id of the room, None if unknown.
        observes: Ids of the wall surfaces observed from here.
    """

    id: str
    stamp_ns: Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63)]
    pose: tuple[Number, Number, Number, Number, Number, Number, Number]
    floor: str | None = None
    room: str | None = None
    observes: tuple[str, ...] = ()
