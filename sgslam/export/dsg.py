"""The scene graph in the JSON format of Spark-DSG (github.com/MIT-SPARK/Spark-DSG, version 1.1), as Hydra writes it.

Layers: BUILDINGS, FLOORS, ROOMS, OBJECTS (wall surfaces and doors), and keyframes as agents. Each node is a child of
the node it lies in. Edges connect rooms joined by a door, and consecutive keyframes. Attributes that Spark-DSG lacks
are in the nodes' metadata.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.report import RunFolder

FILE = "scene_graph_dsg.json"
Floats = NDArray[np.float64]
_OBJECTS, _ROOMS, _FLOORS, _BUILDINGS = 2, 4, 5, 6
_AGENT = ord("a")  # the partition of layer 2 for the robot's poses
_LAYERS = {
    "OBJECTS": _OBJECTS, "AGENTS": _OBJECTS, "PLACES": 3, "ROOMS": _ROOMS, "FLOORS": _FLOORS, "BUILDINGS": _BUILDINGS,
}  # fmt: skip
_WALL, _DOOR = 0, 1  # labels of objects
_COLORS = {_BUILDINGS: (120, 120, 120), _FLOORS: (90, 90, 160), _ROOMS: (70, 130, 180), _OBJECTS: (205, 133, 63)}
_UPRIGHT = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
_NO_BOX = {"type": "INVALID", "dimensions": [0.0] * 3, "world_P_center": [0.0] * 3, "world_R_center": _UPRIGHT}
_FEATURE = {"cols": 0, "data": None, "rows": 0}
_NO_LABEL = 4294967295


def dsg(run: RunFolder) -> dict[str, Any]:
    """The JSON content of the file, in the frame of the run's `trajectory.tum`."""
    return _Writer(run).graph()


class _Writer:
    def __init__(self, run: RunFolder) -> None:
        self._run, self._graph = run, run.s_graph
        numbered: dict[str, tuple[Any, ...]] = {
            "F": self._graph.floors, "R": self._graph.rooms, "O": self._graph.wall_surfaces, "D": self._graph.doors,
            "a": self._graph.keyframes,
        }  # fmt: skip
        self._ids = {item.id: _symbol(letter, i) for letter, items in numbered.items() for i, item in enumerate(items)}
        self._nodes: list[dict[str, Any]] = []
        self._edges: list[dict[str, Any]] = []

    def graph(self) -> dict[str, Any]:
        """The complete graph."""
        self._building()
        self._rooms()
        self._walls()
        self._doors()
        self._agents()
        keys = [{"layer": n, "partition": 0} for n in sorted(set(_LAYERS.values()))]
        return {
            "SPARK_DSG_header": {"project_name": "sgslam", "version": {"major": 1, "minor": 1, "patch": 3}},
            "directed": False, "multigraph": False, "nodes": self._nodes, "edges": self._edges,
            "layer_keys": [*keys, {"layer": _OBJECTS, "partition": _AGENT}],
            "layer_names": {name: {"layer": n, "partition": 0} for name, n in _LAYERS.items()},
            "metadata": {
                "frame": self._run.frame,
                "labelspaces": {f"_l{_OBJECTS}p0": [[_WALL, "wall"], [_DOOR, "door"]]},
            },
        }  # fmt: skip

    def _node(
        self, symbol: int, layer: int, kind: str, position: Floats, metadata: dict[str, Any], **more: Any
    ) -> None:
        attributes = {
            "type": kind, "position": position.tolist(), "is_active": False, "is_predicted": False,
            "last_update_time_ns": 0, "metadata": metadata, **more,
        }  # fmt: skip
        partition = _AGENT if kind == "AgentNodeAttributes" else 0
        self._nodes.append({"id": symbol, "layer": layer, "partition": partition, "attributes": attributes})

    def _named(
        self, symbol: int, layer: int, position: Floats, name: str, metadata: dict[str, Any],
        box: dict[str, Any] | None = None, label: int = _NO_LABEL,
    ) -> None:  # fmt: skip
        more: dict[str, Any] = {"semantic_class_probabilities": {}}
        kind = "RoomNodeAttributes"
        if layer == _OBJECTS:
            kind, more = "ObjectNodeAttributes", {"mesh_connections": [], "registered": False}
            more["world_R_object"] = (box or _NO_BOX)["world_R_center"]
        r, g, b = _COLORS[layer]
        self._node(
            symbol, layer, kind, position, metadata, name=name, semantic_label=label, semantic_feature=_FEATURE,
            color={"r": r, "g": g, "b": b, "a": 255}, bounding_box=box or _NO_BOX, **more,
        )  # fmt: skip

    def _edge(self, source: int, target: int) -> None:
        info = {"type": "EdgeAttributes", "weighted": False, "weight": 1.0, "metadata": {}}
        self._edges.append({"source": source, "target": target, "info": info})

    def _building(self) -> None:
        building = _symbol("B", 0)
        rooms = self._run.on_floor([room.centroid for room in self._graph.rooms], None)
        middle = rooms.mean(axis=0) if len(rooms) else self._run.keyframe_poses[:, :3, 3].mean(axis=0)
        self._named(building, _BUILDINGS, middle, "building", {})
        for floor in self._graph.floors:
            own = [room.centroid for room in self._graph.rooms if room.floor == floor.id]
            place = self._run.on_floor(own, floor.id).mean(axis=0) if own else middle
            self._named(self._ids[floor.id], _FLOORS, place, floor.name or floor.id, {"id": floor.id})
            self._edge(building, self._ids[floor.id])

    def _above(self, room: str | None, floor: str | None) -> int:
        """The parent node: the room if known, else the floor, else the building."""
        return self._ids.get(room or "", self._ids.get(floor or "", _symbol("B", 0)))

    def _rooms(self) -> None:
        for room in self._graph.rooms:
            outline = self._run.on_floor(list(room.polygon or ()), room.floor)
            (place,) = self._run.on_floor([room.centroid], room.floor)
            name = self._run.planned_rooms.get(room.id, room.name or room.id)
            box = None
            if len(outline):
                low, high = outline.min(axis=0), outline.max(axis=0)
                walls = self._graph.surfaces_of_room[room.id]
                high[2] = max([high[2], *(self._run.corners(wall)[:, 2].max() for wall in walls)])
                box = _box("AABB", (low + high) / 2, high - low, np.eye(3))
            self._named(self._ids[room.id], _ROOMS, place, name, {"id": room.id, "polygon": outline.tolist()}, box)
            self._edge(self._above(None, room.floor), self._ids[room.id])

    def _walls(self) -> None:
        for wall in self._graph.wall_surfaces:
            corners, normal = self._run.corners(wall), self._run.rotated(wall.normal)
            along, up = corners[0] - corners[1], corners[2] - corners[0]
            size = np.array([np.linalg.norm(along), 0.0, np.linalg.norm(up)])
            axes = np.stack([np.cross(normal, up / size[2]), normal, up / size[2]], axis=1)
            metadata = {"id": wall.id, "normal": normal.tolist(), "corners": corners.tolist()}
            middle = corners.mean(axis=0)
            self._named(
                self._ids[wall.id], _OBJECTS, middle, wall.id, metadata, _box("OBB", middle, size, axes), _WALL
            )  # fmt: skip
            self._edge(self._above(wall.room, wall.floor), self._ids[wall.id])

    def _doors(self) -> None:
        floor_of = {room.id: room.floor for room in self._graph.rooms}
        for door in self._graph.doors:
            floor = floor_of.get(door.rooms[0]) if door.rooms else None
            (place,) = self._run.on_floor([door.centroid], floor)
            metadata = {"id": door.id, "rooms": list(door.rooms)}
            self._named(self._ids[door.id], _OBJECTS, place, door.id, metadata, label=_DOOR)
            self._edge(self._above(door.rooms[0] if door.rooms else None, floor), self._ids[door.id])
        joined = {tuple(sorted(door.rooms)) for door in self._graph.doors if len(set(door.rooms)) == 2}
        for first, second in sorted(joined):  # Spark-DSG allows one edge between two nodes
            self._edge(self._ids[first], self._ids[second])

    def _agents(self) -> None:
        for i, (keyframe, T) in enumerate(zip(self._graph.keyframes, self._run.keyframe_poses, strict=True)):
            own, metadata = self._ids[keyframe.id], {"id": keyframe.id, "observes": list(keyframe.observes)}
            self._node(
                own, _OBJECTS, "AgentNodeAttributes", T[:3, 3], metadata, timestamp=keyframe.stamp_ns,
                world_R_body=_quaternion(T[:3, :3]), external_key=own, dbow_ids=None, dbow_values=None,
            )  # fmt: skip
            self._edge(self._above(keyframe.room, keyframe.floor), own)
            if i:
                self._edge(self._ids[self._graph.keyframes[i - 1].id], own)


def _symbol(letter: str, number: int) -> int:
    """Spark-DSG's id of a node: a letter in the highest byte, then a number."""
    return ord(letter) << 56 | number


def _box(kind: str, centre: Floats, size: Floats, R_world_box: Floats) -> dict[str, Any]:
    return {
        "type": kind, "dimensions": size.tolist(), "world_P_center": centre.tolist(),
        "world_R_center": _quaternion(R_world_box),
    }  # fmt: skip


def _quaternion(R: Floats) -> dict[str, float]:
    x, y, z, w = Rotation.from_matrix(R).as_quat(canonical=True).tolist()
    return {"w": w, "x": x, "y": y, "z": z}
