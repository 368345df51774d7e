"""Rooms by their aligned walls: which planned room each is, and its anchor."""

import numpy as np
from numpy.typing import NDArray

import factors
from sgslam.anchoring.wall_alignment import AlignedWall
from sgslam.geometry.frames import se2_to_se3
from sgslam.mapping.scene import Scene

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
