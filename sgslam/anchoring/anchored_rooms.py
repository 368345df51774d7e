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
) -> list[list[str | float | None]]:
    """(S room, A room, confidence): as in the match, unless most of a room's walls stand in another planned room.

    `least` is the confidence of pairs that are not in the match.
    """
    votes: dict[str, dict[str, float]] = {}
    for h in aligned:
        if h.surface.room is not None and h.planned.room is not None:
            own = votes.setdefault(h.surface.room, {})
            own[h.planned.room] = own.get(h.planned.room, 0.0) + (h.surface.length or 0.0)
    known = {s: (a, c) for s, a, c in from_match}
    rooms: list[list[str | float | None]] = []
    for s_room in sorted({*votes, *known}):
        own = votes.get(s_room, {})
        most = max(own, key=lambda a: (own[a], a), default=None)
        if s_room in known and (most is None or own.get(known[s_room][0], 0.0) >= 0.5 * own[most]):
            rooms.append([s_room, *known[s_room]])
        elif s_room in known or not from_match:
            rooms.append([s_room, most, least])
    return rooms


def room_anchors(scene: Scene, by_rooms: dict[tuple[str, str], dict[int, Floats]], height: float) -> dict[int, Floats]:
    """T_bim_room (4, 4) of each room with aligned walls of two directions in one planned room.

    Its floor is at `height` (m).
    """
    anchors = {}
    for node in scene.rooms:
        choices = [walls for (s_room, _), walls in by_rooms.items() if s_room == scene.room_ids[node.id]]
        if not choices:
            continue
        walls = max(choices, key=len)
        fitted = factors.fit_room(list(walls.values()), [node.walls[wall] for wall in walls])
        if fitted is not None:
            anchors[node.id] = se2_to_se3(0.0, 0.0, 0.0, height) @ fitted
    return anchors


def anchor_statuses(
    alignment: WallAlignment, scene: Scene, matched: set[Key], match_name: str
) -> dict[Key, AnchorStatus]:  # fmt: skip
    """The status of each wall's anchor; pairs in `matched` come from the match `match_name`, others by position."""
    statuses: dict[Key, AnchorStatus] = {}
    for aligned in alignment.walls:
        key = (scene.wall_of_surface[aligned.surface.id], aligned.planned.id)
        by, off = match_name if key in matched else "position", f"{1000 * aligned.offset:+.0f} mm off"
        if aligned.agrees:
            statuses[key] = AnchorStatus("tight", by, f"as planned within {1000 * alignment.gate:.0f} mm")
        elif key not in statuses:
            statuses[key] = AnchorStatus("loose", by, f"{off} the plan")
    return statuses


def planned_walls(
    alignment: WallAlignment, scene: Scene, statuses: dict[Key, AnchorStatus], T_local_level: Floats, origin: Floats
) -> tuple[dict[int, list[PlannedWall]], dict[tuple[str, str], dict[int, Floats]]]:
    """The planned walls at which each wall of the map stands; and, by (S room, A room), the planes (4,) of the walls
    that agree, in the local frame.

    `origin` (3,) is that of the local frame, T_local_level (4, 4) the place of the map in it.
    """
    found: dict[int, dict[str, PlannedWall]] = {}
    by_rooms: dict[tuple[str, str], dict[int, Floats]] = {}
    names = wall_names([aligned.planned for aligned in alignment.walls])
    for aligned in alignment.walls:
        wall, plane = scene.wall_of_surface[aligned.surface.id], _local_plane(aligned.planned, origin)
        middle = np.array([*aligned.surface.centroid, np.mean(aligned.surface.height or 0.0)])
        status = statuses[wall, aligned.planned.id]
        place = transform_points(T_local_level, middle)
        planned = PlannedWall(plane, place, aligned.planned.id, status.by, status.why, names[aligned.planned.id])
        found.setdefault(wall, {})[aligned.planned.id] = planned
        rooms = aligned.surface.room, aligned.planned.room
        if aligned.agrees and rooms[0] is not None and rooms[1] is not None:
            by_rooms.setdefault((rooms[0], rooms[1]), {})[wall] = plane
    return {wall: list(planned.values()) for wall, planned in found.items()}, by_rooms


def _local_plane(surface: WallSurface, origin: Floats) -> Floats:
    """(4,) the plane of a planned surface in the local frame."""
    plane = np.array(surface.plane or factors.plane_from_wall(surface.normal, surface.centroid), dtype=float)
    plane[:3] /= np.linalg.norm(plane[:3])
    plane[3] += plane[:3] @ origin
    return plane
