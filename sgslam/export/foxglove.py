"""A run as an MCAP file for Foxglove and Lichtblick: poses, walls and rooms of map and plan, and the point cloud map.

Needs the extra `foxglove`.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import atomic_file
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.export.foxglove_messages import (
    Colour,
    Message,
    cloud_message,
    entity,
    label,
    line,
    pose_message,
    scene_message,
    transform_message,
    triangles,
)
from sgslam.export.foxglove_schemas import CLOUD, LINE_LOOP, LINE_STRIP, POSE, SCENE, TRANSFORM, Schema
from sgslam.report import RunFolder
from sgslam.viewer.shapes import elevation_of, quad_mesh, wall_quads

FILE = "run.mcap"
SENSOR = "sensor"  # the frame of the LiDAR
Floats = NDArray[np.float64]
_MAP_WALL: Colour = (0.90, 0.53, 0.17, 0.5)
_PLAN_WALL: Colour = (0.55, 0.58, 0.62, 0.25)
_ROOM: Colour = (0.25, 0.47, 0.79, 1.0)
_PATH: Colour = (0.27, 0.64, 0.35, 1.0)
_TEXT: Colour = (0.1, 0.1, 0.1, 1.0)
_TOPICS: dict[str, Schema] = {
    "/tf": TRANSFORM, "/trajectory": POSE, "/map": SCENE, "/map/cloud": CLOUD, "/plan": SCENE,
}  # fmt: skip
_Stamped = tuple[str, int, Message]  # topic, ns, message


def write_mcap(path: Path, run: RunFolder, trajectory: Trajectory, cloud: Floats) -> int:
    """Writes a run atomically and returns the number of messages: `trajectory` and the points of `cloud` (N, 3) are in
    the run's frame. What does not move has the first stamp.

    Raises UserError if the extra is missing, and for a trajectory that is empty or begins before 1970.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise UserError(f"{path}: mcap is not installed; pip install 'sgslam[foxglove]'") from None
    if not len(trajectory) or trajectory.stamps_ns[0] < 0:
        raise UserError(f"{path.parent}: no poses, or stamps before 1970, which MCAP cannot hold")
    count = 0
    with atomic_file(path) as file:
        writer = Writer(file)
        writer.start()
        channels = {topic: _channel(writer, topic) for topic in _TOPICS}
        for topic, stamp_ns, message in _messages(run, trajectory, cloud):
            data = json.dumps(message, allow_nan=False).encode()
            writer.add_message(channels[topic], log_time=stamp_ns, data=data, publish_time=stamp_ns)
            count += 1
        writer.finish()
    return count


def _channel(writer: Any, topic: str) -> int:
    schema = _TOPICS[topic]
    number = writer.register_schema(schema["title"], "jsonschema", json.dumps(schema).encode())
    return int(writer.register_channel(topic, "json", number))


def _messages(run: RunFolder, trajectory: Trajectory, cloud: Floats) -> Iterator[_Stamped]:
    begin, origin = int(trajectory.stamps_ns[0]), np.floor(trajectory.positions[0])
    if run.T_bim_map is not None:
        yield "/tf", begin, transform_message(begin, run.frame, "map", run.T_bim_map)
    yield "/map", begin, scene_message(_map_entities(begin, run, trajectory, origin))
    if run.a_graph is not None and run.T_bim_map is not None:
        yield "/plan", begin, scene_message(_plan_entities(begin, run.a_graph, run.frame, origin))
    yield "/map/cloud", begin, cloud_message(begin, run.frame, cloud, origin)
    for stamp, T_frame_sensor in zip(trajectory.stamps_ns.tolist(), trajectory.poses, strict=True):
        yield "/tf", stamp, transform_message(stamp, run.frame, SENSOR, T_frame_sensor)
        yield "/trajectory", stamp, pose_message(stamp, run.frame, T_frame_sensor)


def _map_entities(stamp_ns: int, run: RunFolder, trajectory: Trajectory, origin: Floats) -> list[Message]:
    graph, frame = run.s_graph, run.frame
    matched = {s: a for s, a, _ in run.matches.get("wall_surfaces") or ()} if run.T_bim_map is not None else {}
    found = [entity(stamp_ns, frame, "path", {}, lines=[line(LINE_STRIP, trajectory.positions, origin, _PATH)])]
    for wall in graph.wall_surfaces:
        told = {"room": wall.room, "planned": matched.get(wall.id)}
        mesh = quad_mesh(run.corners(wall)[None, [0, 1, 3, 2]])
        known = {name: value for name, value in told.items() if value is not None}
        found.append(entity(stamp_ns, frame, wall.id, known, triangles=[triangles(mesh, origin, _MAP_WALL)]))
    for room in graph.rooms:
        name, (place,) = run.planned_rooms.get(room.id, room.name or room.id), run.on_floor([room.centroid], room.floor)
        ring = run.on_floor(list(room.polygon or ()), room.floor)
        found.append(_room(stamp_ns, frame, room.id, name, place, ring, origin))
    return found


def _plan_entities(stamp_ns: int, plan: SceneGraph, frame: str, origin: Floats) -> list[Message]:
    found = []
    for wall in plan.wall_surfaces:
        mesh = quad_mesh(wall_quads([wall], elevation_of(plan, wall.floor), absolute=True))
        found.append(entity(stamp_ns, frame, wall.id, {}, triangles=[triangles(mesh, origin, _PLAN_WALL)]))
    for room in plan.rooms:
        z = elevation_of(plan, room.floor)
        place, ring = np.array([*room.centroid, z]), np.array([(x, y, z) for x, y in room.polygon or ()])
        found.append(_room(stamp_ns, frame, room.id, room.name or room.id, place, ring.reshape(-1, 3), origin))
    return found


def _room(
    stamp_ns: int, frame: str, identity: str, name: str, place: Floats, ring: Floats, origin: Floats
) -> Message:  # fmt: skip
    lines = [line(LINE_LOOP, ring, origin, _ROOM)] if len(ring) else []
    return entity(stamp_ns, frame, identity, {"name": name}, lines=lines, texts=[label(name, place, _TEXT)])
