"""Anchors to the BIM. The BIM frame is a pose variable in the map: a plane that the BIM "sees" is the same
kind of measurement as a plane that a keyframe sees, and a room that it "sees" is one pose between two
others."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.planes import observe_plane


def anchor_plane(
    plane_in_bim: ArrayLike, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """A wall of the plan (4,) in BIM coordinates, matched to the plane variable `plane` in the frame of
    `anchor`.

    `bim` is the pose variable T_map_bim. Residual (3) as in `observe_plane`: how far the wall as built is
    from the wall as planned. At least two directions of normals must be matched before `bim` is determined.
    """
    return observe_plane(plane_in_bim, bim, anchor, plane, noise)


def storey_plane(
    elevation: float, bim: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """A storey's finished floor at `elevation` (m, BIM frame), matched to the floor's plane variable.

    It anchors height, roll and pitch, which no wall can. Residual (3) as in `observe_plane`.
    """
    return observe_plane([0.0, 0.0, 1.0, -elevation], bim, anchor, plane, noise)


def anchor_room(
    T_bim_room: ArrayLike, bim: int, room: int, sigma_yaw: float, sigma_place: float
) -> gtsam.NoiseModelFactor:
    """A room of the plan: its pose (4, 4) in BIM coordinates, matched to the room's pose variable.

    Residual (6): log of the pose difference, rotation first. Height, roll and pitch are left loose (100 m, 3
    rad): walls do not give them. Huber at 1.345. Raises ValueError for sigmas that are not positive, and for
    a pose that is not finite.
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
