"""How uncertain the motion between two keyframes is, where an external odometry tells it."""

import numpy as np
import pytest
from boxes import Array, pose

from data import UserError
from sgslam.config import OdometrySettings
from sgslam.perception.scan_checks import checked_covariance
from sgslam.session.scan_poses import StepUncertainty


def test_what_is_given_for_the_scans_since_the_last_keyframe_adds_up_in_the_axes_of_the_newest() -> None:
    steps, none, along_x = StepUncertainty(OdometrySettings()), np.zeros((6, 6)), np.diag([0, 0, 0, 0.04, 0, 0])
    steps.leave(none, True)
    steps.add(along_x, np.eye(3))
    steps.add(along_x, pose(0.0, 0.0, 0.0, -np.pi / 2)[:3, :3])  # turned left, so that x before is -y now
    covariance, weak = steps.leave(none, True)
    nothing, strong = steps.leave(none, True)  # since then
    np.testing.assert_allclose(np.diag(covariance - nothing), [0.0, 0.0, 0.0, 0.04, 0.04, 0.0], atol=1e-12)
    assert weak and not strong and np.all(np.diag(nothing) > 0)


@pytest.mark.parametrize("wrong", [np.eye(3), -np.eye(6), np.triu(np.ones((6, 6))), np.full((6, 6), np.nan)])
def test_what_is_no_covariance_is_refused(wrong: Array) -> None:
    with pytest.raises(UserError, match="step_covariance must be a covariance"):
        checked_covariance(wrong, 5)
    assert checked_covariance(np.eye(6), 5).shape == (6, 6)
