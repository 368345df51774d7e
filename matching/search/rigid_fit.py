"""Fits a proper rigid motion to matched walls and rooms, for methods that only return matches."""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array

ROOM_WEIGHT = 0.1  # of a centroid relative to a wall: decides only what the walls leave undetermined


def fit_pairs(s_walls: Array, a_walls: Array, s_rooms: Array, a_rooms: Array) -> Array:
    """Returns (3,) T_a_s (yaw, x, y) from N pairs of walls (N, 4), each x, y of a point and of the normal, and M of
    rooms (M, 2).

    The rotation is the mean of the normals'; the translation moves points of walls onto their partners' lines by least
    squares. Without walls, the rotation is that of the rooms about their mean. At least one pair is needed.
    """
    if len(s_walls):
        normals = (w[:, 2:] @ np.array([1, 1j]) for w in (a_walls, s_walls))
    else:
        normals = ((c - c.mean(axis=0)) @ np.array([1, 1j]) for c in (a_rooms, s_rooms))
    theirs, ours = normals
    turn = float(np.angle(np.sum(theirs * ours.conj())))
    off = a_walls[:, :2] - se2.rotate(turn, s_walls[:, :2])
    apart = a_rooms - se2.rotate(turn, s_rooms)
    rows = [a_walls[:, 2:], *(ROOM_WEIGHT * np.tile(axis, (len(apart), 1)) for axis in np.eye(2))]
    values = [np.sum(a_walls[:, 2:] * off, axis=-1), *(ROOM_WEIGHT * apart[:, k] for k in (0, 1))]
    shift = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
    return np.array([turn, *shift])
