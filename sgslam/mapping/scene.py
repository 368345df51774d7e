"""Builds the S-graph from the estimates: rooms from free space, and the surfaces of each wall by the rooms it faces."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from data.geometry.poses import poses_to_xyzquat
from sgslam.config import Config
from sgslam.geometry.frames import inverse, se2_to_se3, transform_planes, transform_points
from sgslam.mapping.keyframes import KeyframeNode, RoomNode
from sgslam.mapping.rooms import Segmentation, free_space, segment
from sgslam.mapping.wall_map import WallMap

Floats = NDArray[np.float64]
_MOST_ROOMS = 2**20  # of a floor; room nodes are numbered floor after floor
STEP = 0.1  # m between the places along a wall at which it is looked up whether it was seen, and the room that it faces
_INSIDE = 0.2  # m from the wall into the room


@dataclass(frozen=True)
class Scene:
    """The S-graph in the map frame, with the back end's numbers of its walls and rooms."""

    graph: SceneGraph
    wall_of_surface: dict[str, int]
    rooms: list[RoomNode]
    room_ids: dict[int, str]  # of the room nodes

    def relabelled(self, current: Callable[[int], int]) -> "Scene":
        """The scene after walls were joined; `current` gives a wall's number now."""
        wall_of = {name: current(wall) for name, wall in self.wall_of_surface.items()}
        rooms = [replace(room, walls={current(wall): p for wall, p in room.walls.items()}) for room in self.rooms]
        return replace(self, wall_of_surface=wall_of, rooms=rooms)


def build_scene(
    keyframes: list[KeyframeNode], walls: WallMap, floor_in_map: Floats | None, config: Config, storey: int = 0
) -> Scene:
    """Builds rooms and wall surfaces of a floor from the present estimates; `keyframes` are those of all floors.

    Plan coordinates are those of the levelled map; `floor_in_map` (4,) is the floor's plane, None if not observed.
    """
    T_level_map, id_ = walls.T_level_map, f"floor-{storey}"
    suffix = f"f{storey}" if storey else ""  # of ids, which are unique over the floors of a run
    own = {i: k for i, k in enumerate(keyframes) if k.storey == storey}
    T_level_sensor = T_level_map @ np.stack([k.T_map_sensor for k in own.values()])
    segmentation = _segment(own, walls, T_level_sensor, config)
    room_of = {room.label: f"r{room.label}{suffix}" for room in segmentation.rooms}
    surfaces, wall_of = _surfaces(walls, segmentation, room_of, id_, config)
    rooms = tuple(
        Room(room_of[r.label], _xy(r.centroid), id_, polygon=tuple(_xy(p) for p in r.polygon))
        for r in segmentation.rooms
    )
    doors = tuple(
        Door(f"d{i}{suffix}", tuple(room_of[label] for label in labels), _xy(middle))
        for i, (labels, middle) in enumerate(segmentation.passages.items())
    )
    elevation = 0.0 if floor_in_map is None else float(-floor_in_map[3] / floor_in_map[2])
    seen_from = _keyframes(
        own, walls, wall_of, id_, [room_of.get(label) for label in segmentation.at(T_level_sensor[:, :2, 3]).tolist()]
    )
    graph = SceneGraph("map", rooms, surfaces, doors, (Floor(id_, "", elevation),), seen_from)
    nodes = []
    for room in segmentation.rooms:
        T_map_room = inverse(T_level_map) @ se2_to_se3(0.0, *room.centroid)
        T_room_map = inverse(T_map_room)
        mine = [wall_of[w.id] for w in graph.surfaces_of_room[room_of[room.label]]]
        in_room = {wall: transform_planes(T_room_map, walls.planes_in_map[wall]) for wall in mine}
        nodes.append(RoomNode(storey * _MOST_ROOMS + room.label, T_map_room, in_room))
    ids = dict(zip((node.id for node in nodes), room_of.values(), strict=True))
    return Scene(graph, wall_of, nodes, ids)


def _segment(own: dict[int, KeyframeNode], walls: WallMap, T: Floats, config: Config) -> Segmentation:
    keyframes, row = list(own.values()), {i: k for k, i in enumerate(own)}
    outlines = (transform_points(pose, k.outline)[:, :2] for pose, k in zip(T, keyframes, strict=True))
    lintels = (transform_points(pose, k.lintels)[:, :2] for pose, k in zip(T, keyframes, strict=True))
    segments = np.empty((0, 2, 2))
    if walls.seen:
        ends = np.stack([s.ends for s in walls.seen])
        segments = transform_points(T[[row[s.keyframe] for s in walls.seen]][:, None], ends)[..., :2]
    space = free_space(T[:, :2, 3], outlines, segments, lintels)
    return segment(space, T[:, :2, 3], config.rooms)


def _surfaces(
    walls: WallMap, segmentation: Segmentation, room_of: dict[int, str], floor: str, config: Config
) -> tuple[tuple[WallSurface, ...], dict[str, int]]:
    """One surface for each room that a well-observed wall faces, and one for its longest part that faces none."""
    lines = walls.lines
    covered = walls.coverage(STEP)
    heights = walls.heights()
    surfaces: list[WallSurface] = []
    wall_of: dict[str, int] = {}
    for row, wall in enumerate(lines.ids.tolist()):
        if lines.count[row] < config.surfaces.min_observations:
            continue
        normal = lines.normal[row]
        tangent = np.array([-normal[1], normal[0]])
        places = covered[wall]
        points = places[:, None] * tangent - lines.offset[row] * normal
        facing = segmentation.at(points + _INSIDE * normal)
        for label, mine in _by_room(places, facing).items():
            if len(mine) * STEP < config.surfaces.min_length:
                continue
            low, high = mine.min() - STEP / 2, mine.max() + STEP / 2
            centre = (low + high) / 2 * tangent - lines.offset[row] * normal
            room, plane = room_of.get(label), tuple(walls.planes_in_map[wall].tolist())
            name, length = f"w{wall}@{room}" if room else f"w{wall}", float(high - low)
            surfaces.append(
                WallSurface(name, room, _xy(centre), _xy(normal), length, floor, height=heights[wall], plane=plane)
            )
            wall_of[name] = wall
    return tuple(surfaces), wall_of


def _by_room(places: Floats, facing: NDArray[np.int32]) -> dict[int, Floats]:
    """The places of a wall by the label of the room that they face; label 0 has the longest part that faces none."""
    parts = {label: places[facing == label] for label in np.unique(facing).tolist() if label}
    free = facing == 0
    for mine in parts.values():
        free &= (places < mine.min()) | (places > mine.max())
    where = np.flatnonzero(free)
    longest = max(np.split(where, np.flatnonzero(np.diff(where) > 1) + 1), key=len)
    return {0: places[longest], **parts}


def _keyframes(
    keyframes: dict[int, KeyframeNode], walls: WallMap, wall_of: dict[str, int], floor: str, rooms: list[str | None]
) -> tuple[Keyframe, ...]:
    """The keyframes of a floor, with the surfaces that they saw; `rooms` are those that they are in."""
    surfaces: dict[int, list[str]] = {}
    for name, wall in wall_of.items():
        surfaces.setdefault(wall, []).append(name)
    observes: dict[int, set[str]] = {}
    for s in walls.seen:
        observes.setdefault(s.keyframe, set()).update(surfaces.get(s.wall, ()))
    poses = poses_to_xyzquat(np.stack([k.T_map_sensor for k in keyframes.values()])).tolist()
    return tuple(
        Keyframe(f"k{i}", k.stamp_ns, tuple(pose), floor, room, tuple(sorted(observes.get(i, ()))))
        for (i, k), pose, room in zip(keyframes.items(), poses, rooms, strict=True)
    )


def _xy(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])
