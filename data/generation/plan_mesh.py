"""A plan as a mesh that can be driven through: rooms between walls, doorways under lintels, floor and ceiling."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import nearest_points

from data.common.errors import UserError
from data.geometry.areas import Area, triangles_of, united
from data.scene_graph import Door, SceneGraph

Array = NDArray[np.float64]
OUTER = 0.3  # m, thickness of outer walls; walls between rooms are at most twice as thick
SLAB = 0.2  # m
HEIGHT = 2.75  # m, of a room
LINTEL = 2.1  # m, clear height of a doorway
DOORWAY = 0.9  # m wide
REACH = 0.05  # m that a doorway's outline reaches into the rooms


def write_plan_mesh(graph: SceneGraph, path: Path | str) -> None:
    """Writes the first floor of a plan whose rooms have polygons as a mesh in its own frame, with the floor at 0.

    Raises UserError for a plan without rooms.
    """
    import trimesh

    triangles = plan_triangles(graph)
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles)).export(Path(path))


@dataclass(frozen=True, eq=False)
class DrawnStorey:
    """The first storey of a plan in plan view: its rooms by id, its outline, the walls between them, and the lines
    through its doors, from room to room."""

    rooms: dict[str, Area]
    outline: Area
    walls: Area
    doors: tuple[shapely.LineString, ...]

    @property
    def doorways(self) -> Area:
        """The parts of the walls that are open under a lintel."""
        return united(line.buffer(DOORWAY / 2, cap_style="flat") for line in self.doors)


def drawn_storey(graph: SceneGraph) -> DrawnStorey:
    """The first storey of a plan whose rooms have polygons. Raises UserError for a plan without rooms."""
    floor = graph.floors[0].id if graph.floors else None
    rooms = {r.id: shapely.Polygon(r.polygon) for r in graph.rooms if r.polygon is not None and r.floor == floor}
    if not rooms:
        raise UserError(f"{graph.frame}: a plan without rooms; give one whose rooms have outlines")
    inside = united(list(rooms.values()))
    outline = inside.buffer(OUTER, join_style="mitre")
    lines = (_through(door, rooms) for door in graph.doors)
    return DrawnStorey(rooms, outline, outline.difference(inside), tuple(line for line in lines if line is not None))


def plan_triangles(graph: SceneGraph) -> Array:
    """(M, 3, 3) the triangles of `write_plan_mesh`, turned outwards. Raises UserError for a plan without rooms."""
    storey = drawn_storey(graph)
    outline, walls = storey.outline, storey.walls
    parts = [
        extruded(outline, -SLAB, 0.0),
        extruded(walls.difference(storey.doorways), 0.0, LINTEL),
        extruded(walls, LINTEL, HEIGHT),
        extruded(outline, HEIGHT, HEIGHT + SLAB),
    ]
    return np.concatenate(parts)


def _through(door: Door, rooms: dict[str, Area]) -> shapely.LineString | None:
    """The line through the wall between a door's two rooms, None for any other door."""
    joined = [rooms[name] for name in door.rooms if name in rooms]
    if len(joined) != 2:
        return None
    ends = np.array([nearest_points(room, shapely.Point(door.centroid))[0].coords[0] for room in joined])
    across = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-6)
    return shapely.LineString([ends[0] - REACH * across, ends[1] + REACH * across])


def extruded(area: Area, low: float, high: float) -> Array:
    """(M, 3, 3) the surface of a body with this outline from a lower to an upper height, turned outwards."""
    import trimesh

    corners = triangles_of(area).reshape(-1, 2)
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    body = trimesh.creation.extrude_triangulation(vertices, faces.reshape(-1, 3), high - low)
    return np.asarray(body.triangles) + np.array([0.0, 0.0, low])
