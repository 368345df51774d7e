"""Where a scan's points lie once its motion has been estimated again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sgslam.geometry.frames import inverse, transform_points
from sgslam.registration.motion import pose_of_points
from sgslam.registration.points import UNKNOWN, placed
from sgslam.types import Motion, TimedPoints

SECONDS = np.array([0.0, 0.05, 0.1])


def turning(rate: float, heading: float = 0.4) -> Motion:
    """A walk at 1 m/s with an angular velocity (rad/s) about the vertical."""
    knots = np.tile(np.eye(4), (len(SECONDS), 1, 1))
    knots[:, :3, :3] = Rotation.from_rotvec(np.outer(heading + rate * SECONDS, [0, 0, 1])).as_matrix()
    knots[:, 0, 3] = SECONDS
    return Motion(SECONDS, knots)


@pytest.mark.parametrize("window", [(0.0, 0.1), (0.0, 0.03), (0.07, 0.1)])
@pytest.mark.parametrize("mistake", [0.1, -0.3])  # rad/s
def test_points_placed_by_a_wrong_turn_lie_right_as_a_body(window: tuple[float, float], mistake: float) -> None:
    """The stamp is at the scan's begin, where a turn that is off moves all later points to one side."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (500, 3))
    scan = TimedPoints(points, rng.uniform(*window, 500), SECONDS, np.full(500, UNKNOWN, np.int32))
    true, wrong = turning(0.5), turning(0.5 + mistake)
    from_stamp = Motion(SECONDS, inverse(wrong.knots[0]) @ wrong.knots)
    cloud = placed(points, scan.seconds, SECONDS, from_stamp.knots)[0]
    right = placed(points, scan.seconds, SECONDS, true.knots)[0]
    off = {
        name: np.linalg.norm(np.mean(np.cross(points, transform_points(T, cloud) - right), axis=0))
        for name, T in (("body", pose_of_points(scan, from_stamp, true)), ("stamp", true.knots[0]))
    }
    assert off["body"] < 0.15 * off["stamp"]


def test_the_pose_is_that_at_the_stamp_where_the_motion_was_right() -> None:
    scan = TimedPoints(np.ones((9, 3)), np.linspace(0, 0.1, 9), SECONDS, np.full(9, UNKNOWN, np.int32))
    motion = turning(0.5)
    from_stamp = Motion(SECONDS, inverse(motion.knots[0]) @ motion.knots)
    assert np.allclose(pose_of_points(scan, from_stamp, motion), motion.knots[0], atol=1e-9)
