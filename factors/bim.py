"""Anchors to the BIM. The BIM frame is a pose variable of the graph.

A plane of the plan is then the same kind of measurement as a plane observed from a keyframe. A room is a pose, whose
walls are planes that are observed from it (S-Graphs; Bavle et al. 2022, arXiv 2212.11770); a room of the plan is a
relative pose between two variables. This holds for any shape and heading, and wherever the map begins.
"""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.noise import diagonal, robust
from factors.planes import observe_plane


def anchor_plane(
    plane_in_bim: ArrayLike, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties a plane variable to the wall of the plan it was matched with.

    `plane_in_bim` (4,) is the planned wall, `bim` the key of the BIM pose T_map_bim; the others as of `observe_plane`,
    as is the residual, in the BIM frame: how far the wall as built is from the wall as planned. `bim` is determined
    only if walls of at least two directions are matched. If walls are far from the BIM's origin, use a frame near them
    (`frame_at`, `plane_from`); otherwise a small rotation looks like an offset. Source: the BIM as one more pose that
    observes planes, after the anchors of iS-Graphs (Shaheer et al. 2023, arXiv 2303.02076). Raises ValueError as
    `observe_plane`.
    """
    return observe_plane(plane_in_bim, bim, anchor, plane, noise)


def frame_at(place_in_bim: ArrayLike, bim: int, frame: int, sigma: float = 1e-5) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties a pose variable `frame` rigidly to `bim`, at `place_in_bim` (3,) and without rotation.

    Both variables are poses in the map. Residual (6): logarithm of the pose difference, rotation (rad) first, then
    translation (m); all have the standard deviation `sigma`. With 1e-5, Levenberg-Marquardt may need tens of steps if
    the start is decimetres off; with 1e-4, a few. Source: BetweenFactor of GTSAM. Raises ValueError for a place that is
    not finite.
    """
    T_bim_frame = gtsam.Pose3(gtsam.Rot3(), _checked_place(place_in_bim))
    return gtsam.BetweenFactorPose3(bim, frame, T_bim_frame, gtsam.noiseModel.Isotropic.Sigma(6, sigma))


def plane_from(place_in_bim: ArrayLike, plane_in_bim: ArrayLike) -> NDArray[np.float64]:
    """Returns (4,) a plane given in the BIM frame (4,), expressed in the frame that `frame_at` puts at a place (3,).

    Raises ValueError for a place that is not finite.
    """
    place, plane = _checked_place(place_in_bim), np.asarray(plane_in_bim, dtype=float)
    return np.array([*plane[:3], plane[3] + float(plane[:3] @ place)])


def storey_plane(
    elevation: float, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base, side: float = 1.0
) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties a floor's plane variable to a storey's finished floor at `elevation` (m, BIM frame).

    It determines height, roll and pitch, which walls cannot. `side` is -1 for a ceiling, which is seen from below.
    Variables as in `anchor_plane`; residual (3) as in `observe_plane`, in the BIM frame, where z points up. Source: as
    `anchor_plane`. Raises ValueError for an elevation that is not finite.
    """
    return observe_plane([0.0, 0.0, side, -side * elevation], bim, anchor, plane, noise)


def anchor_room(
    T_bim_room: ArrayLike, bim: int, room: int, sigma_yaw: float, sigma_place: float
) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties a room's pose variable to the pose of the planned room it was matched with.

    `T_bim_room` (4, 4) is the pose of the planned room, `bim` the key of T_map_bim, `room` that of T_map_room. The
    sigmas are standard deviations of the yaw (rad), and of x and y (m).

    Residual (6): logarithm of the pose difference in the planned room's frame, rotation (rad) first, then translation
    (m). Height, roll and pitch are left free (100 m, 3 rad), since walls do not determine them. Huber loss at 1.345.
    Source: BetweenFactor of GTSAM. Raises ValueError unless the sigmas are positive and the pose is (4, 4) and finite.
    """
    noise = robust(diagonal([3.0, 3.0, sigma_yaw, sigma_place, sigma_place, 100.0]), 1.345)
    return gtsam.BetweenFactorPose3(bim, room, gtsam.Pose3(_checked_pose("T_bim_room", T_bim_room)), noise)


def anchor_point(T_bim_frame: ArrayLike, bim: int, frame: int, sigma: float) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties the origin of a pose variable `frame` to a surveyed place in the BIM frame.

    `T_bim_frame` (4, 4) has the place, and the present attitude of `frame`, which is left free (3 rad); `sigma` is the
    standard deviation (m) of each coordinate. Residual (6) and loss as of `anchor_room`. Put the frame where a sensor
    has the point with `frame_at`. Source: BetweenFactor of GTSAM. Raises ValueError as `anchor_room`.
    """
    pose, noise = _checked_pose("T_bim_frame", T_bim_frame), diagonal([3.0, 3.0, 3.0, sigma, sigma, sigma])
    return gtsam.BetweenFactorPose3(bim, frame, gtsam.Pose3(pose), robust(noise, 1.345))


def fit_room(planes_in_bim: ArrayLike, planes_in_room: ArrayLike) -> NDArray[np.float64] | None:
    """Returns (4, 4) T_bim_room, the pose that aligns a room's vertical walls with the planned ones; z, roll and pitch
    are 0.

    `planes_in_bim` (M, 4) are planned walls, `planes_in_room` (M, 4) the same walls in the room's frame, row by row.
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


def _checked_pose(name: str, value: ArrayLike) -> NDArray[np.float64]:
    pose = np.asarray(value, dtype=float)
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        raise ValueError(f"{name} must be (4, 4) and finite, not {pose}")
    return pose


def _checked_place(place: ArrayLike) -> NDArray[np.float64]:
    value = np.asarray(place, dtype=float)
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise ValueError(f"a place must be three finite numbers, not {value}")
    return value
