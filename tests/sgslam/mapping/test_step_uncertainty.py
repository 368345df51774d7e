"""How uncertain the motion between two keyframes is, where an external odometry tells it."""

import numpy as np
import pytest
from boxes import pose

from data import UserError
from sgslam.config import OdometrySettings
from sgslam.perception.scan_checks import checked_covariance
from sgslam.session.soundness.step_uncertainty import StepUncertainty

BASE = np.repeat([OdometrySettings().other_sigma_rotation, OdometrySettings().other_sigma_translation], 3) ** 2


def test_what_is_told_of_the_scans_since_the_last_keyframe_adds_up_in_the_axes_of_the_newest() -> None:
    steps, none = StepUncertainty(OdometrySettings()), np.zeros((6, 6))
    steps.leave(none, True)
    along_x = np.diag([0.0, 0.0, 0.0, 0.04, 0.0, 0.0])
    quarter = pose(0.0, 0.0, 0.0, -np.pi / 2)[:3, :3]  # the sensor turned left, so that x before is -y now
    steps.tell(along_x, np.eye(3))
    steps.tell(along_x, quarter)
    covariance, weak = steps.leave(none, True)
    np.testing.assert_allclose(np.diag(covariance), BASE + np.array([0.0, 0.0, 0.0, 0.04, 0.04, 0.0]), atol=1e-12)
    assert weak
    covariance, weak = steps.leave(none, True)  # nothing was told since
    np.testing.assert_allclose(np.diag(covariance), BASE)
    assert not weak


def test_what_is_no_covariance_is_refused() -> None:
    crooked = np.eye(6)
    crooked[0, 1] = 0.5
    for wrong in (np.eye(3), -np.eye(6), crooked, np.full((6, 6), np.nan)):
        with pytest.raises(UserError, match="step_covariance must be a covariance"):
            checked_covariance(wrong, 5)
    assert checked_covariance(np.eye(6), 5).shape == (6, 6)
