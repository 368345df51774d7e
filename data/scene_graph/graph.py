"""`SceneGraph`: floors, rooms, wall and level surfaces, doors, keyframes. A-graph and S-graph are scene graphs.

Lengths are in metres, angles in radians. Coordinates are in the graph's own frame: `bim` (the IFC model's world frame)
for an A-graph, `map` for an S-graph.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from data.common.errors import UserError
from data.common.files import read_json, write_json
from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph.georeference import Georeference
from data.scene_graph.nodes import Door, Floor, Keyframe, LevelSurface, Room, WallSurface, Xy

SCHEMA_VERSION = 1
STEEPEST = 0.9  # upright part of a level surface's normal, at least
_LONGEST_MEDIAN = 50.0  # m; drawn and real graphs have 1 to 10, in centimetres 80 and more
_FEWEST = 4  # walls; fewer say nothing about all
MIRRORED = ", mirrored"  # added to the name of a frame
Pose = tuple[float, float, float, float, float, float, float]  # x y z, and a quaternion qx qy qz qw


@dataclass(frozen=True)
class SceneGraph:
    """A building as planned (A-graph, frame `bim`) or as mapped (S-graph, frame `map`). Immutable. Only a plan has
    `level_surfaces`, if it has heights, and a `georeference`, if it is known.

    Raises UserError where an id is used twice, a surface refers to a missing room, a centroid or a normal is not
    (x, y), a normal is not a unit vector, a length is not positive, a level surface is steep or has no polygon, or a
    number is not finite.
    """

    frame: str
    rooms: tuple[Room, ...] = ()
    wall_surfaces: tuple[WallSurface, ...] = ()
    doors: tuple[Door, ...] = ()
    floors: tuple[Floor, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    level_surfaces: tuple[LevelSurface, ...] = ()
    georeference: Georeference | None = None

    def __post_init__(self) -> None:
        everything: list[Room | WallSurface | Door | Floor | Keyframe | LevelSurface] = [
            *self.rooms, *self.wall_surfaces, *self.doors, *self.floors, *self.keyframes, *self.level_surfaces
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
        surfaces: tuple[WallSurface | LevelSurface, ...] = (*self.wall_surfaces, *self.level_surfaces)
        for node in surfaces:
            if node.room is not None and node.room not in self.room_by_id:
                raise UserError(f"scene graph: surface '{node.id}' refers to a missing room '{node.room}'")
        for surface in self.wall_surfaces:
            if abs(math.hypot(*surface.normal) - 1) > 1e-2:  # planes of a real map are not quite upright
                raise UserError(f"scene graph: the normal of wall surface '{surface.id}' is not a unit vector")
            if surface.length is not None and not surface.length > 0:
                raise UserError(f"scene graph: wall surface '{surface.id}' has no positive length")
        for level in self.level_surfaces:
            if abs(math.hypot(*level.plane[:3]) - 1) > 1e-6 or abs(level.plane[2]) < STEEPEST:
                raise UserError(f"scene graph: the plane of level surface '{level.id}' is steep or not of unit length")
            if min(map(len, (level.polygon, *level.holes))) < 3:
                raise UserError(f"scene graph: level surface '{level.id}' has a ring of fewer than three corners")
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
        found: dict[str, list[WallSurface]] = {r.id: [] for r in self.rooms}
        for surface in self.wall_surfaces:
            if surface.room is not None:
                found[surface.room].append(surface)
        return {room: tuple(own) for room, own in found.items()}

    def on_floor(self, floor: str | None) -> "SceneGraph":
        """The part of the graph on one floor, given by id; None selects nodes without a floor. Wall and level surfaces
        are where their room is, and a room without a floor is where its first wall surface with one is."""
        of_walls = {w.room: w.floor for w in reversed(self.wall_surfaces) if w.floor is not None}
        floor_of = {r.id: of_walls.get(r.id) if r.floor is None else r.floor for r in self.rooms}
        rooms = tuple(r for r in self.rooms if floor_of[r.id] == floor)
        kept = {r.id for r in rooms}
        walls = (w for w in self.wall_surfaces if (w.floor if w.room is None else floor_of[w.room]) == floor)
        levels = (v for v in self.level_surfaces if (v.floor if v.room is None else floor_of[v.room]) == floor)
        return SceneGraph(
            self.frame,
            rooms,
            tuple(walls),
            tuple(d for d in self.doors if kept.intersection(d.rooms)),
            tuple(f for f in self.floors if f.id == floor),
            tuple(k for k in self.keyframes if k.floor == floor),
            tuple(levels),
        )

    def centroid(self) -> NDArray[np.float64]:
        """(2,) the mean of the rooms' centroids, or of the wall surfaces' if there are no rooms."""
        points = [r.centroid for r in self.rooms] or [w.centroid for w in self.wall_surfaces] or [(0.0, 0.0)]
        return np.mean(np.asarray(points, dtype=float), axis=0)

    def to_dict(self) -> dict[str, Any]:
        """The graph as plain data in the form of `scene_graph.schema.json`, version 1."""
        return {"schema_version": SCHEMA_VERSION, **{f.name: _plain(getattr(self, f.name)) for f in fields(self)}}

    @staticmethod
    def from_dict(value: Any) -> "SceneGraph":
        """A graph of the form of `to_dict`; unknown properties are ignored. Raises UserError for other data, and as the
        constructor does."""
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
        """Reads a graph from a JSON file, if it has the key `part` from there (such as `a_graph` in a file of a pair of
        graphs). Raises UserError, naming the file, if it is missing or does not hold a scene graph."""
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


def implausible(graph: SceneGraph) -> str | None:
    """What seems to be wrong with a graph, in one line; None if nothing does.

    Lengths seem to be in millimetres or centimetres if half of the walls are longer than 50 m or, if no length is
    known, farther than that from their room's centroid. Normals seem to be flipped if there are at least four walls
    with a room, more than half of them face away from its centroid, and the sum over all walls of length times distance
    to the centroid along the normal is negative: around a room of any shape it is twice the floor area (divergence
    theorem).
    """
    walls = [w for w in graph.wall_surfaces if w.room is not None]
    inwards = np.array([_towards_centroid(graph, wall) for wall in walls])
    lengths = [w.length for w in graph.wall_surfaces if w.length is not None]
    sizes = lengths or np.abs(inwards).tolist()
    if sizes and (median := float(np.median(sizes))) > _LONGEST_MEDIAN:
        what = "the median wall is" if lengths else "the median wall is, from its room's centroid,"
        return f"{what} {median:.0f} m; its lengths seem to be in millimetres or centimetres, give metres"
    outwards = int(np.count_nonzero(inwards < 0))
    area = float(inwards @ [w.length or 1.0 for w in walls]) / 2 if walls else 0.0
    if len(walls) >= _FEWEST and 2 * outwards > len(walls) and area < 0:
        return f"the normals of {outwards} of {len(walls)} walls point out of the room they bound; flip them"
    return None


def _towards_centroid(graph: SceneGraph, wall: WallSurface) -> float:
    """How far (m) the centroid of the wall's room is before the wall; negative behind it."""
    (x, y), (cx, cy), (nx, ny) = wall.centroid, graph.room_by_id[wall.room or ""].centroid, wall.normal
    return (cx - x) * nx + (cy - y) * ny


def moved(graph: SceneGraph, T_out_graph: Array) -> SceneGraph:
    """Moves rooms, wall surfaces and doors by (yaw, x, y) in rad and m: p_out = R(yaw) p_graph + (x, y).

    Ids, order and the frame's name stay; `plane`s, level surfaces and keyframes are left out.
    """
    T = np.asarray(T_out_graph, dtype=float)

    def at(point: Xy) -> Xy:
        x, y = se2.apply(T, np.array(point)).tolist()
        return x, y

    def turned(normal: Xy) -> Xy:
        x, y = se2.rotate(float(T[0]), np.array(normal)).tolist()
        return x, y

    return _mapped(graph, at, turned)


def mirrored(graph: SceneGraph) -> SceneGraph:
    """The mirror image: y becomes -y, of the sensor's axes too. Ids and order stay, the frame's name says it; `plane`s
    and level surfaces are left out."""

    def flipped(point: Xy) -> Xy:
        return point[0], -point[1]

    image = _mapped(graph, flipped, flipped)
    rooms = tuple(replace(r, polygon=None if r.polygon is None else r.polygon[::-1]) for r in image.rooms)
    walls = tuple(
        replace(w, parts=tuple((source, -b, -a, full) for source, a, b, full in reversed(w.parts)))
        for w in image.wall_surfaces
    )
    keyframes = tuple(replace(k, pose=_flipped_pose(*k.pose)) for k in graph.keyframes)
    frame = graph.frame.removesuffix(MIRRORED) if graph.frame.endswith(MIRRORED) else graph.frame + MIRRORED
    return replace(image, frame=frame, rooms=rooms, wall_surfaces=walls, keyframes=keyframes)


def _flipped_pose(x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float) -> Pose:
    return x, -y, z, -qx, qy, -qz, qw


def _mapped(graph: SceneGraph, at: Callable[[Xy], Xy], turned: Callable[[Xy], Xy]) -> SceneGraph:
    def room(r: Room) -> Room:
        return replace(r, centroid=at(r.centroid), polygon=None if r.polygon is None else tuple(map(at, r.polygon)))

    def wall(w: WallSurface) -> WallSurface:
        return replace(w, centroid=at(w.centroid), normal=turned(w.normal), plane=None)

    doors = tuple(replace(d, centroid=at(d.centroid)) for d in graph.doors)
    rooms, walls = tuple(map(room, graph.rooms)), tuple(map(wall, graph.wall_surfaces))
    return SceneGraph(graph.frame, rooms, walls, doors, graph.floors)
