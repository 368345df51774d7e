"""Predicted poses: by the odometry, and without the tilt that it makes up."""

import gtsam
import numpy as np
from numpy.typing import NDArray

from sgslam.geometry.frames import inverse

Floats = NDArray[np.float64]


def upright_step(predicted: Floats, last_map: Floats, up_in_map: Floats) -> Floats:
    """The predicted T_map_sensor without the tilt since `last_map`: of a turn only the part about the vertical.

    KISS-ICP leans by degrees from scan to scan where few rings see floor and ceiling; a sensor in a building hardly
    does, and what it does lean, the walls and the floor tell.
    """
    turn = gtsam.Rot3.Logmap(gtsam.Rot3(predicted[:3, :3] @ last_map[:3, :3].T))
    upright = predicted.copy()
    upright[:3, :3] = gtsam.Rot3.Expmap(up_in_map * (up_in_map @ turn)).matrix() @ last_map[:3, :3]
    return upright


def predict(last_map: Floats, last_odom: Floats, now_odom: Floats) -> Floats:
    """T_map_sensor of now, by the odometry since a pose that is known in the map."""
    return last_map @ inverse(last_odom) @ now_odom
