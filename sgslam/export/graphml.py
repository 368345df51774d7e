"""The scene graph as GraphML, for Gephi, yEd, Cytoscape, igraph and networkx."""

import io
import json
import re
from typing import TYPE_CHECKING, Any

from sgslam.report import RunFolder

if TYPE_CHECKING:
    import networkx

FILE = "scene_graph.graphml"
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # not allowed in XML


def graph_of(run: RunFolder) -> "networkx.Graph[str]":
    """The S-graph as a networkx graph.

    Nodes have the ids of the S-graph, a `kind` (floor, room, wall_surface, door, keyframe) and x, y, z in the frame of
    the run's `trajectory.tum`. Edges have a `kind`: part_of (room to floor), faces (surface to room), joins (door to
    room), in (keyframe to room), observes (keyframe to surface), next (keyframe to keyframe).
    """
    import networkx

    s, graph = run.s_graph, networkx.Graph(frame=run.frame)

    def node(identity: str, kind: str, place: Any, **more: Any) -> None:
        x, y, z = (float(value) for value in place)
        attributes = {k: _NO_XML.sub("", v) if isinstance(v, str) else v for k, v in more.items() if v is not None}
        graph.add_node(identity, kind=kind, x=x, y=y, z=z, **attributes)

    for floor in s.floors:
        node(floor.id, "floor", run.on_floor([(0.0, 0.0)], floor.id)[0], name=floor.name)
    for room in s.rooms:
        outline = json.dumps(run.on_floor(list(room.polygon or ()), room.floor).tolist())
        place, planned = run.on_floor([room.centroid], room.floor)[0], run.planned_rooms.get(room.id)
        node(room.id, "room", place, name=planned or room.name, polygon=outline)
        if room.floor is not None:
            graph.add_edge(room.id, room.floor, kind="part_of")
    for wall in s.wall_surfaces:
        corners, normal = run.corners(wall), run.rotated(wall.normal).tolist()
        low, high = corners[:, 2].min(), corners[:, 2].max()
        sizes = {"length": wall.length, "height": float(high - low), "normal_x": normal[0], "normal_y": normal[1]}
        node(wall.id, "wall_surface", corners.mean(axis=0), **sizes, corners=json.dumps(corners.tolist()))
        if wall.room is not None:
            graph.add_edge(wall.id, wall.room, kind="faces")
    for door in s.doors:
        floors = [s.room_by_id[room].floor for room in door.rooms if room in s.room_by_id]
        node(door.id, "door", run.on_floor([door.centroid], floors[0] if floors else None)[0])
        graph.add_edges_from(((door.id, room) for room in door.rooms), kind="joins")
    for i, (keyframe, T) in enumerate(zip(s.keyframes, run.keyframe_poses, strict=True)):
        node(keyframe.id, "keyframe", T[:3, 3], stamp_ns=str(keyframe.stamp_ns))  # large for an integer
        if keyframe.room is not None:
            graph.add_edge(keyframe.id, keyframe.room, kind="in")
        graph.add_edges_from(((keyframe.id, wall) for wall in keyframe.observes), kind="observes")
        if i:
            graph.add_edge(s.keyframes[i - 1].id, keyframe.id, kind="next")
    return graph


def graphml(run: RunFolder) -> bytes:
    """The content of the file."""
    import networkx

    written = io.BytesIO()
    networkx.write_graphml_xml(graph_of(run), written, infer_numeric_types=False)
    return written.getvalue()
