"""`SceneGraph`: floors, rooms, wall surfaces, doors and keyframes. Both the A-graph and the S-graph are scene graphs.

Lengths are in metres, angles in radians. Coordinates are in the graph's own frame: `bim` (the IFC model's world frame)
for an A-graph, `map` for an S-graph.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from data.common.errors import UserError
from data.common.files import write_json
from data.common.json_files import read_json

FARTHEST = 1e9  # m: no coordinate on the earth is larger, and squares of it stay exact enough
Number = Annotated[float, Field(strict=True, ge=-FARTHEST, le=FARTHEST)]  # no text and no truth value in JSON
Xy = tuple[Number, Number]
SCHEMA_VERSION = 1


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
class Door:
    """A door or passage. `rooms` holds the ids of the rooms it joins (one for an outer door), `centroid` is (x, y) in
    metres.
    """

    id: str
    rooms: tuple[str, ...]
    centroid: Xy


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


@dataclass(frozen=True)
class SceneGraph:
    """A building as planned (A-graph) or as mapped (S-graph). Immutable; ids are unique within the graph.

    Attributes:
        frame: Name of the frame of all coordinates: `bim` or `map`.
        rooms, wall_surfaces, doors, floors, keyframes: The nodes of the graph.

    Raises:
        UserError: An id is used twice, a surface refers to a missing room, a centroid or a normal is not (x, y), a
            normal is not a unit vector, a length is not positive, or a number is not finite.
    """

    frame: str
    rooms: tuple[Room, ...] = ()
    wall_surfaces: tuple[WallSurface, ...] = ()
    doors: tuple[Door, ...] = ()
    floors: tuple[Floor, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()

    def __post_init__(self) -> None:
        """Checks the graph; see the class for what is refused. Raises UserError."""
        everything: list[Room | WallSurface | Door | Floor | Keyframe] = [
            *self.rooms, *self.wall_surfaces, *self.doors, *self.floors, *self.keyframes
        ]  # fmt: skip
        ids = [item.id for item in everything]
        if len(set(ids)) != len(ids):
            twice = next(i for i in ids if ids.count(i) > 1)
            raise UserError(f"scene graph: the id '{twice}' is given twice; ids must be unique")
        nodes: tuple[Room | WallSurface | Door, ...] = (*self.rooms, *self.wall_surfaces, *self.doors)
        points = [(node.id, "centroid", node.centroid) for node in nodes]
        for name, what, value in (*points, *((w.id, "normal", w.normal) for w in self.wall_surfaces)):
            if len(value) != 2:
                raise UserError(f"scene graph: the {what} of '{name}' has {len(value)} numbers; give x and y only")
        for surface in self.wall_surfaces:
            if surface.room is not None and surface.room not in self.room_by_id:
                raise UserError(f"scene graph: wall surface '{surface.id}' refers to a missing room '{surface.room}'")
            if abs(math.hypot(*surface.normal) - 1) > 1e-2:  # planes of a real map are not quite upright
                raise UserError(f"scene graph: the normal of wall surface '{surface.id}' is not a unit vector")
            if surface.length is not None and not surface.length > 0:
                raise UserError(f"scene graph: wall surface '{surface.id}' has no positive length")
        for item in everything:
            if not all(math.isfinite(x) for x in _numbers(vars(item))):
                raise UserError(f"scene graph: '{item.id}' holds a number that is not finite")

    @cached_property
    def room_by_id(self) -> dict[str, Room]:
        """Rooms by id."""
        return {r.id: r for r in self.rooms}

    @cached_property
    def surface_by_id(self) -> dict[str, WallSurface]:
        """Wall surfaces by id."""
        return {w.id: w for w in self.wall_surfaces}

    @cached_property
    def surfaces_of_room(self) -> dict[str, tuple[WallSurface, ...]]:
        """The wall surfaces facing each room, by room id, in the graph's order."""
        facing: dict[str, list[WallSurface]] = {r.id: [] for r in self.rooms}
        for surface in self.wall_surfaces:
            if surface.room is not None:
                facing[surface.room].append(surface)
        return {room: tuple(surfaces) for room, surfaces in facing.items()}

    def on_floor(self, floor: str | None) -> "SceneGraph":
        """Returns the part of the graph on one floor, given by id; None selects nodes without a floor.

        Wall surfaces are where their room is, and a room without a floor is where its first wall surface with one is.
        """
        of_walls = {w.room: w.floor for w in reversed(self.wall_surfaces) if w.floor is not None}
        floor_of = {r.id: of_walls.get(r.id) if r.floor is None else r.floor for r in self.rooms}
        rooms = tuple(r for r in self.rooms if floor_of[r.id] == floor)
        kept = {r.id for r in rooms}
        walls = (w for w in self.wall_surfaces if (w.floor if w.room is None else floor_of[w.room]) == floor)
        return SceneGraph(
            self.frame, rooms, tuple(walls),
            tuple(d for d in self.doors if kept.intersection(d.rooms)),
            tuple(f for f in self.floors if f.id == floor), tuple(k for k in self.keyframes if k.floor == floor),
        )  # fmt: skip

    def centroid(self) -> NDArray[np.float64]:
        """Returns (2,) the mean of the rooms' centroids in metres, or of the wall surfaces' if there are no rooms."""
        points = [r.centroid for r in self.rooms] or [w.centroid for w in self.wall_surfaces] or [(0.0, 0.0)]
        return np.mean(np.asarray(points, dtype=float), axis=0)

    def to_dict(self) -> dict[str, Any]:
        """Returns the graph as plain data in the form of `scene_graph.schema.json`, version 1."""
        return {"schema_version": SCHEMA_VERSION, **{f.name: _plain(getattr(self, f.name)) for f in fields(self)}}

    @staticmethod
    def from_dict(value: Any) -> "SceneGraph":
        """Creates a graph from the form of `to_dict`; unknown properties are ignored.

        Raises UserError if the data does not have this form, or as the constructor does.
        """
        if not isinstance(value, dict) or value.get("schema_version") != SCHEMA_VERSION:
            raise UserError("scene graph: not a scene graph of schema_version 1")
        if missing := [name for name in ("frame", "rooms", "wall_surfaces") if name not in value]:
            raise UserError(f"scene graph: '{missing[0]}' is missing")
        try:
            return _form().validate_python(value)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            message = first["msg"].replace("tuple", "list")
            raise UserError(f"scene graph: {where}: {message} (given: {str(first['input'])[:40]})") from None

    def save(self, path: Path | str) -> None:
        """Writes the graph as JSON, atomically."""
        write_json(path, self.to_dict())

    @staticmethod
    def load(path: Path | str, part: str | None = None) -> "SceneGraph":
        """Reads a graph from a JSON file.

        If the file holds an object with the key `part`, the graph is read from there (for example `a_graph` in a file
        of a pair of graphs). Raises UserError, naming the file, if it is missing or does not hold a scene graph.
        """
        value = read_json(path, "a scene graph's JSON file")
        try:
            return SceneGraph.from_dict(value[part] if isinstance(value, dict) and part in value else value)
        except UserError as error:
            raise UserError(f"{path}: {error}") from None


@cache
def _form() -> TypeAdapter[SceneGraph]:
    return TypeAdapter(SceneGraph)


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return {k: _plain(v) for k, v in asdict(value).items()} if hasattr(value, "__dataclass_fields__") else value


def _numbers(value: Any) -> Iterable[float]:
    if isinstance(value, dict):
        value = value.values()
    elif isinstance(value, (int, float)):
        yield value
        return
    elif not isinstance(value, (list, tuple)):
        return
    for item in value:
        yield from _numbers(item)
