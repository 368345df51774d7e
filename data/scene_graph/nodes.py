"""The nodes of a scene graph: floors, rooms, wall surfaces, level surfaces, doors and keyframes.

Lengths are in metres, angles in radians, coordinates in the graph's frame. Ids are unique within the graph; `floor` and
`room` are those of other nodes. None is unknown.
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
    """A storey; `elevation` is the z of its finished floor."""

    id: str
    name: str = ""
    elevation: Number | None = None


@dataclass(frozen=True)
class Room:
    """A room or corridor: `centroid` (x, y) in metres, and `polygon`, the outer ring of its footprint as (x, y) without
    repeating the first corner."""

    id: str
    centroid: Xy
    floor: str | None = None
    name: str = ""
    polygon: tuple[Xy, ...] | None = None


@dataclass(frozen=True)
class WallSurface:
    """One side of a wall; metres.

    `room` is the one that it faces, `centroid` (x, y) its mid point, `normal` (x, y) a unit vector into the room,
    `plane` (nx, ny, nz, d) with n.x + d = 0. `source` is what it was read from, for example the wall's GlobalId in the
    IFC file. `height` is the z of the lower and the upper edge: in the BIM frame for a plan, above the floor for a map.
    `parts` tell where which wall stands along a planned surface: (source, from, to, whether full-height rather than
    below a window), from the mid point to the left when looking along the normal; gaps between them are doors and other
    openings.
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
        """The end points of the footprint, the left one (looking along the normal) first."""
        half = (self.length or 0.0) / 2
        (cx, cy), (nx, ny) = self.centroid, self.normal
        return (cx - ny * half, cy + nx * half), (cx + ny * half, cy - nx * half)


@dataclass(frozen=True)
class LevelSurface:
    """A planned floor or ceiling of a room, as far as it can be seen from there: level, or a slope of at most 15
    degrees. Those of one `source`, a slab's GlobalId in an IFC file, and plane are parts of one surface.

    `plane` is (nx, ny, nz, d) with n.x + d = 0; n points up from a floor, down from a ceiling. `polygon` and `holes`
    are the rings of the visible part in plan view as (x, y) in metres, without repeating the first corner. `room` is
    the one over the floor or under the ceiling, None outside all rooms, `kind` the class of its source, such as
    `IfcCovering`. `stated`: the plan has the surface itself or its height; False for one that only bounds a space.
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
        """The z of the surface's plane at (x, y)."""
        nx, ny, nz, d = self.plane
        return -(nx * x + ny * y + d) / nz


@dataclass(frozen=True)
class Door:
    """A door or passage; `rooms` are those that it joins (one for an outer door)."""

    id: str
    rooms: tuple[str, ...]
    centroid: Xy
    width: Number | None = None


@dataclass(frozen=True)
class Keyframe:
    """A pose of the sensor in the map: T_map_sensor as (x, y, z, qx, qy, qz, qw), metres and a unit quaternion. `room`
    is that where it is, `observes` are the ids of the wall surfaces that were seen from there."""

    id: str
    stamp_ns: Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63)]
    pose: tuple[Number, Number, Number, Number, Number, Number, Number]
    floor: str | None = None
    room: str | None = None
    observes: tuple[str, ...] = ()
