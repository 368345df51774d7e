"""The anchors that aligned walls become, and the rooms and room anchors that follow from them."""

import numpy as np
from numpy.typing import NDArray

import factors
from data import WallSurface
from data.scene_graph.segments import wall_names
from sgslam.anchoring.anchor_log import AnchorStatus, Key
from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment
from sgslam.geometry.frames import se2_to_se3, transform_points
from sgslam.mapping import PlannedWall, Scene

Floats = NDArray[np.float64]


def matched_rooms(
    aligned: list[AlignedWall], from_match: tuple[tuple[str, str, float], ...], least: float
) -> list[list[str | float]]:
    """(S room, A room, confidence): as in the match, unless most of a room's walls stand in another planned room.

    `least` is the confidence of pairs that are not in the match.
    """
    votes: dict[str, dict[str, float]] = {}
    for h in aligned:
        if h.surface.room is not None and h.planned.room is not None:
            own = votes.setdefault(h.surface.room, {})
            own[h.planned.room] = own.get(h.planned.room, 0.0) + (h.surface.length or 0.0)
    known = {s: (a, c) for s, a, c in from_match}
    rooms: list[list[str | float]] = []
    for s_room in sorted(known or votes):
        own = votes.get(s_room, {})
        most = max(own, key=lambda a: (own[a], a), default="")
        a_room, confidence = known.get(s_room, (most, least))
        if own.get(a_room, 0.0) < 0.5 * own.get(most, 0.0):
            a_room, confidence = most, least
        rooms.append([s_room, a_room, confidence])
    return rooms


def anchor_statuses(alignment: WallAlignment, scene: Scene, by: str) -> dict[Key, AnchorStatus]:
    """The status of each wall's anchor; `by` is the match that placed the map."""
    statuses: dict[Key, AnchorStatus] = {}
    for aligned in alignment.walls:
        key = (scene.wall_of_surface[aligned.surface.id], aligned.planned.id)
        if aligned.agrees:
            statuses[key] = AnchorStatus("tight", by, f"as planned within {1000 * alignment.gate:.0f} mm")
        else:
            statuses.setdefault(key, AnchorStatus("loose", by, f"{1000 * aligned.offset:+.0f} mm off the plan"))
    return statuses


def planned_walls(
    alignment: WallAlignment, scene: Scene, T_local_level: Floats, origin: Floats
) -> dict[int, list[PlannedWall]]:
    """The planned walls at which each wall of the map stands.

    `origin` (3,) is that of the local frame, T_local_level (4, 4) the place of the map in it.
    """
    found: dict[int, dict[str, PlannedWall]] = {}
    names = wall_names([aligned.planned for aligned in alignment.walls])
    for aligned in alignment.walls:
        wall, a_id = scene.wall_of_surface[aligned.surface.id], aligned.planned.id
        middle = np.array([*aligned.surface.centroid, np.mean(aligned.surface.height or 0.0)])
        place = transform_points(T_local_level, middle)
        planned = PlannedWall(_local_plane(aligned.planned, origin), place, a_id, names[a_id])
        found.setdefault(wall, {})[a_id] = planned
    return {wall: list(planned.values()) for wall, planned in found.items()}


def room_anchors(alignment: WallAlignment, scene: Scene, origin: Floats, height: float) -> dict[int, Floats]:
    """T_bim_room (4, 4) of each room with walls of two directions that agree with those of one planned room.

    Its floor is at `height` (m).
    """
    planes: dict[str, dict[str, dict[int, Floats]]] = {}  # by the S room, the A room and the wall
    for aligned in alignment.walls:
        s_room, a_room = aligned.surface.room, aligned.planned.room
        if aligned.agrees and s_room is not None and a_room is not None:
            own = planes.setdefault(s_room, {}).setdefault(a_room, {})
            own[scene.wall_of_surface[aligned.surface.id]] = _local_plane(aligned.planned, origin)
    anchors = {}
    for node in scene.rooms:
        walls = max(planes.get(scene.room_ids[node.id], {}).values(), key=len, default={})
        fitted = factors.fit_room(list(walls.values()), [node.walls[wall] for wall in walls])
        if fitted is not None:
            anchors[node.id] = se2_to_se3(0.0, 0.0, 0.0, height) @ fitted
    return anchors


def _local_plane(surface: WallSurface, origin: Floats) -> Floats:
    """(4,) the plane of a planned surface in the local frame."""
    plane = np.array(surface.plane or factors.plane_from_wall(surface.normal, surface.centroid), dtype=float)
    plane[:3] /= np.linalg.norm(plane[:3])
    plane[3] += plane[:3] @ origin
    return plane
