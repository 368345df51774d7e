"""Rooms as poses, whose walls are planes in the room's frame.

No factor of its own is needed for a room. This holds for any shape and heading and does not depend on the map's
origin.
"""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.planes import observe_plane


def wall_of_room(
    plane_in_room: ArrayLike, room: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """Returns a factor for a room's wall (4,) in the frame of the room's pose variable.

    Variables: the poses `room` T_map_room and `anchor` T_map_anchor, and `plane` in the anchor's frame. Residual (3) as
    in `observe_plane`, in the room's frame. It replaces the room factors of S-Graphs (Bavle et al. 2022, arXiv
    2212.11770), whose residual depends on the map's origin and which only handle rectangles. Raises ValueError as
    `observe_plane`.
    """
    return observe_plane(plane_in_room, room, anchor, plane, noise)


def fit_room(planes_in_bim: ArrayLike, planes_in_room: ArrayLike) -> NDArray[np.float64] | None:
    """Returns (4, 4) T_bim_room, the pose that aligns a room's vertical walls with the planned ones; z, roll and pitch
    are 0.

    Args:
        planes_in_bim: (M, 4) planned walls in the BIM frame.
        planes_in_room: (M, 4) the same walls in the room's frame, row by row.

    The yaw is the mean rotation of the normals, the position the least-squares solution of the offsets. Returns None if
    the normals span only one direction, since the room could then slide along its walls.
    """
    planned, seen = np.asarray(planes_in_bim, dtype=float), np.asarray(planes_in_room, dtype=float)
    if len(planned) < 2 or np.linalg.svd(planned[:, :2], compute_uv=False)[1] < 0.5:
        return None
    cross = seen[:, 0] * planned[:, 1] - seen[:, 1] * planned[:, 0]
    dot = np.sum(seen[:, :2] * planned[:, :2], axis=1)
    yaw = np.arctan2(cross.sum(), dot.sum())
    # a plane moves as d_bim = d_room - n_bim . t
    place, *_ = np.linalg.lstsq(planned[:, :2], seen[:, 3] - planned[:, 3], rcond=None)
    T_bim_room = np.eye(4)
    T_bim_room[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T_bim_room[:2, 3] = place
    return T_bim_room
