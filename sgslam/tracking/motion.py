"""Predicts poses from the odometry, without its spurious tilt."""

import gtsam
import numpy as np
from numpy.typing import NDArray

from sgslam.geometry.frames import inverse

Floats = NDArray[np.float64]


def upright_step(predicted: Floats, last_map: Floats, up_in_map: Floats) -> Floats:
    """The predicted T_map_sensor (4, 4) with only the rotation about the vertical since `last_map` (4, 4).

    KISS-ICP tilts by degrees from scan to scan where few rings see floor and ceiling. A sensor in a building hardly
    tilts; its real tilt follows from the alignment with walls and floor. `up_in_map` (3,) is the vertical.
    """
    turn = gtsam.Rot3.Logmap(gtsam.Rot3(predicted[:3, :3] @ last_map[:3, :3].T))
    upright = predicted.copy()
    upright[:3, :3] = gtsam.Rot3.Expmap(up_in_map * (up_in_map @ turn)).matrix() @ last_map[:3, :3]
    return upright


def predict(last_map: Floats, last_odom: Floats, now_odom: Floats) -> Floats:
    """T_map_sensor (4, 4) from the odometry since the last pose; all arguments (4, 4)."""
    return last_map @ inverse(last_odom) @ now_odom
