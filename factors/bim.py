"""Anchors to the BIM. The BIM frame is a pose variable in the map: a plane that the BIM "sees" is the same
kind of measurement as a plane that a keyframe sees, and a room that it "sees" is one pose between two
others."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.planes import observe_plane


def anchor_plane(
    plane_in_bim: ArrayLike, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """A wall of the plan (4,) in BIM coordinates, matched to the plane variable `plane` in the frame of
    `anchor`.

    Variables: `bim`, the pose T_map_bim, `anchor` T_map_anchor, `plane` in the anchor's frame. Residual (3) as in
    `observe_plane`: how far the wall as built is from the wall as planned, in BIM coordinates. At least two directions
    of normals must be matched before `bim` is determined. Where walls lie far from the BIM's origin, give `bim` a
    frame near the wall (`frame_at`, `plane_from`): else a small turn passes for an offset. Source: the BIM as one
    more pose that sees planes, after the anchors of iS-Graphs (Shaheer et al. 2023, arXiv 2303.02076).
    """
    return observe_plane(plane_in_bim, bim, anchor, plane, noise)


def frame_at(place_in_bim: ArrayLike, bim: int, frame: int) -> gtsam.NoiseModelFactor:
    """A frame that stands at `place_in_bim` (3,), turned as the BIM's: pose variable `frame`, tied to `bim` for good.

    Both are poses in the map. Residual (6): log of the pose difference, rotation (rad) first, then translation (m).
    Source: Between factor of GTSAM. Raises ValueError for a place that is not finite.
    """
    T_bim_frame = gtsam.Pose3(gtsam.Rot3(), _checked_place(place_in_bim))
    return gtsam.BetweenFactorPose3(bim, frame, T_bim_frame, gtsam.noiseModel.Isotropic.Sigma(6, 1e-5))


def plane_from(place_in_bim: ArrayLike, plane_in_bim: ArrayLike) -> NDArray[np.float64]:
    """(4,) a plane (4,) in BIM coordinates in the frame that `frame_at` puts at `place_in_bim` (3,)."""
    place, plane = _checked_place(place_in_bim), np.asarray(plane_in_bim, dtype=float)
    return np.array([*plane[:3], plane[3] + float(plane[:3] @ place)])


def storey_plane(
    elevation: float, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """A storey's finished floor at `elevation` (m, BIM frame), matched to the floor's plane variable.

    It anchors height, roll and pitch, which no wall can. Variables as in `anchor_plane`; residual (3) as in
    `observe_plane`, in BIM coordinates, where z points up. Source: as `anchor_plane`. Raises ValueError for an
    elevation that is not finite.
    """
    return observe_plane([0.0, 0.0, 1.0, -elevation], bim, anchor, plane, noise)


def anchor_room(
    T_bim_room: ArrayLike, bim: int, room: int, sigma_yaw: float, sigma_place: float
) -> gtsam.NoiseModelFactor:
    """A room of the plan: its pose (4, 4) in BIM coordinates, matched to the room's pose variable.

    Variables: `bim` T_map_bim, `room` T_map_room. Residual (6): log of the pose difference in the planned room's frame,
    rotation (rad) first, then translation (m). Height, roll and pitch are left loose (100 m, 3 rad): walls do not give
    them. Huber at 1.345. Source: Between factor of GTSAM; a room as a pose after S-Graphs (Bavle et al. 2022, arXiv
    2212.11770). Raises ValueError for sigmas that are not positive, and for a pose that is not finite.
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
        raise ValueError(f"a place is three finite numbers, not {value}")
    return value
