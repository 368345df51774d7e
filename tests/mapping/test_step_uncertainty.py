"""How uncertain the motion between two keyframes is: where an external odometry tells it, and over unseen ground."""

import numpy as np
import pytest
from boxes import pose

from data import UserError
from sgslam.config import Config
from sgslam.perception.scan_checks import checked_covariance
from sgslam.session.step_uncertainty import StepUncertainty

CONFIG = Config()
BASE = np.repeat([CONFIG.odometry.other_sigma_rotation, CONFIG.odometry.other_sigma_translation], 3) ** 2
UP = np.array([0.0, 0.0, 1.0])


def test_what_is_told_of_the_scans_since_the_last_keyframe_adds_up_in_the_axes_of_the_newest() -> None:
    steps, none = StepUncertainty(CONFIG), np.zeros((6, 6))
    steps.leave(none, UP, 0.5, True)
    along_x = np.diag([0.0, 0.0, 0.0, 0.04, 0.0, 0.0])
    quarter = pose(0.0, 0.0, 0.0, -np.pi / 2)[:3, :3]  # the sensor turned left, so that x before is -y now
    steps.tell(along_x, np.eye(3))
    steps.tell(along_x, quarter)
    covariance, weak = steps.leave(none, UP, 0.5, True)
    np.testing.assert_allclose(np.diag(covariance), BASE + np.array([0.0, 0.0, 0.0, 0.04, 0.04, 0.0]), atol=1e-12)
    assert weak
    covariance, weak = steps.leave(none, UP, 0.5, True)  # nothing was told since
    np.testing.assert_allclose(np.diag(covariance), BASE)
    assert not weak


@pytest.mark.parametrize(("sigma", "rises"), [(0.002, False), (CONFIG.tracking.sway, True), (1.0, True)])
def test_the_ground_may_rise_where_no_surface_shows_the_height(sigma: float, rises: bool) -> None:
    """Over ten metres of way by a step of some 0.3 m, whichever way the sensor is held; else the step stays as sure."""
    for up in (UP, np.array([0.6, 0.0, 0.8])):
        steps, held, height = StepUncertainty(CONFIG), np.zeros((6, 6)), 0.0
        held[3:, 3:] = sigma**2 * np.outer(up, up)
        steps.leave(held, up, 0.5, False)
        for _ in range(20):
            covariance, weak = steps.leave(held, up, 0.5, False)
            height += float(up @ covariance[3:, 3:] @ up)
            level = np.array([0.0, 1.0, 0.0])
            assert np.sqrt(level @ covariance[3:, 3:] @ level) == pytest.approx(CONFIG.odometry.sigma_translation)
            assert not weak
        assert (0.2 < np.sqrt(height) < 0.5) if rises else np.sqrt(height) < 0.03


def test_what_is_no_covariance_is_refused() -> None:
    crooked = np.eye(6)
    crooked[0, 1] = 0.5
    for wrong in (np.eye(3), -np.eye(6), crooked, np.full((6, 6), np.nan)):
        with pytest.raises(UserError, match="step_covariance must be a covariance"):
            checked_covariance(wrong, 5)
    assert checked_covariance(np.eye(6), 5).shape == (6, 6)
