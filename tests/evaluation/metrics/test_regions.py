"""How often errors of poses lie inside the 95 % regions of their standard deviations."""

import numpy as np
import pytest

from data import UserError
from data.trajectory import Trajectory
from evaluation.metrics.regions import inside_95
from sgslam.geometry.frames import se2_to_se3

STAMPS = np.arange(4000, dtype=np.int64) * 10**8
TRUTH = Trajectory(STAMPS, np.stack([se2_to_se3(0.001 * k, 0.01 * k, 1.0) for k in range(len(STAMPS))]))


@pytest.fixture(scope="module")
def estimate() -> Trajectory:
    """With errors of 2 cm and 0.02 rad."""
    rng, poses = np.random.default_rng(0), TRUTH.poses.copy()
    poses[:, :3, 3] += rng.normal(0.0, 0.02, (len(poses), 3))
    turned = np.stack([se2_to_se3(yaw, 0.0, 0.0) for yaw in rng.normal(0.0, 0.02, len(poses))])
    poses[:, :3, :3] = turned[:, :3, :3] @ poses[:, :3, :3]
    return Trajectory(STAMPS, poses)


@pytest.mark.parametrize(("sigma", "plan_view", "height"), [(0.02, 0.95, 0.95), (0.01, 0.527, 0.673)])
def test_true_sigmas_hold_95_percent_of_the_errors_and_half_of_them_fewer(
    estimate: Trajectory, sigma: float, plan_view: float, height: float
) -> None:
    found = inside_95(estimate, TRUTH, np.full((len(STAMPS), 6), sigma))
    assert found is not None and found.poses == len(STAMPS)
    shares = (found.plan_view, found.height, found.yaw)
    assert shares == pytest.approx((plan_view, height, height), abs=0.035)


def test_poses_of_unknown_sigma_do_not_count(estimate: Trajectory) -> None:
    sigma = np.full((len(STAMPS), 6), np.nan)
    assert inside_95(estimate, TRUTH, sigma) is None
    sigma[:10] = 1.0
    found = inside_95(estimate, TRUTH, sigma)
    assert found is not None and (found.poses, found.height) == (10, 1.0)
    with pytest.raises(UserError, match="sigmas of shape"):
        inside_95(estimate, TRUTH, sigma[:5])
