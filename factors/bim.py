"""Anchors to the BIM. The BIM frame is a pose variable of the graph.

A plane of the plan is then the same kind of measurement as a plane observed from a keyframe, and a room of the plan is
a relative pose between two variables.
"""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.planes import observe_plane


def anchor_plane(
    plane_in_bim: ArrayLike, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """Returns a factor that ties a plane variable to the wall of the plan it was matched with.

    Args:
        plane_in_bim: (4,) the planned wall in the BIM frame.
        bim: Key of the BIM pose, T_map_bim.
        anchor: Key of the anchor pose, T_map_anchor.
        plane: Key of the plane variable, in the frame of `anchor`.
        noise: Three-dimensional noise model, see `noise_of_plane`.

    Residual (3) as in `observe_plane`, in the BIM frame: how far the wall as built is from the wall as planned. `bim`
    is determined only if walls of at least two directions are matched. If walls are far from the BIM's origin, use a
    frame near them (`frame_at`, `plane_from`); otherwise a small rotation looks like an offset. Source: the
    BIM as one more pose that observes planes, after the anchors of iS-Graphs (Shaheer et al. 2023, arXiv 2303.02076).

    Raises:
        ValueError: As `observe_plane`.
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

    Args:
        T_bim_room: (4, 4) pose of the planned room in the BIM frame.
        bim: Key of the BIM pose, T_map_bim.
        room: Key of the room's pose, T_map_room.
        sigma_yaw: Standard deviation of the yaw in radians.
        sigma_place: Standard deviation of x and y in metres.

    Residual (6): logarithm of the pose difference in the planned room's frame, rotation (rad) first, then translation
    (m). Height, roll and pitch are left free (100 m, 3 rad), since walls do not determine them. Huber loss at 1.345.
    Source: BetweenFactor of GTSAM; rooms as poses after S-Graphs (Bavle et al. 2022, arXiv 2212.11770).

    Raises:
        ValueError: A sigma is not positive, or the pose is not (4, 4) and finite.
    """
    sigmas = np.array([3.0, 3.0, sigma_yaw, sigma_place, sigma_place, 100.0])
    if not (np.all(np.isfinite(sigmas)) and sigmas.min() > 0):
        raise ValueError(f"sigmas must be positive and finite, not {sigmas}")
    pose = np.asarray(T_bim_room, dtype=float)
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        raise ValueError(f"T_bim_room must be (4, 4) and finite, not {pose}")
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.345)
    noise = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Diagonal.Sigmas(sigmas))
    return gtsam.BetweenFactorPose3(bim, room, gtsam.Pose3(pose), noise)


def _checked_place(place: ArrayLike) -> NDArray[np.float64]:
    value = np.asarray(place, dtype=float)
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise ValueError(f"a place must be three finite numbers, not {value}")
    return value
