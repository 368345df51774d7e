"""How often errors of poses lie inside the 95 % regions of their standard deviations."""

import numpy as np
import pytest

from data import UserError
from data.trajectory import Trajectory
from evaluation.metrics.regions import inside_95
from sgslam.geometry.frames import se2_to_se3

STAMPS = np.arange(4000, dtype=np.int64) * 10**8
TRUTH = Trajectory(STAMPS, np.stack([se2_to_se3(0.001 * k, 0.01 * k, 1.0) for k in range(len(STAMPS))]))


def estimated(sigma: float, seed: int = 0) -> Trajectory:
    rng, poses = np.random.default_rng(seed), TRUTH.poses.copy()
    poses[:, :3, 3] += rng.normal(0.0, sigma, (len(poses), 3))
    turned = np.stack([se2_to_se3(yaw, 0.0, 0.0) for yaw in rng.normal(0.0, sigma, len(poses))])
    poses[:, :3, :3] = turned[:, :3, :3] @ poses[:, :3, :3]
    return Trajectory(STAMPS, poses)


def test_true_sigmas_hold_95_percent_of_the_errors() -> None:
    found = inside_95(estimated(0.02), TRUTH, np.full((len(STAMPS), 6), 0.02))
    assert found is not None and found.poses == len(STAMPS)
    for share in (found.plan_view, found.height, found.yaw):
        assert 0.93 < share < 0.97  # four standard deviations of a share of 4,000


def test_sigmas_that_are_half_as_large_hold_fewer() -> None:
    found = inside_95(estimated(0.02), TRUTH, np.full((len(STAMPS), 6), 0.01))
    assert found is not None
    assert found.height == pytest.approx(0.673, abs=0.04) and found.plan_view == pytest.approx(0.527, abs=0.04)


def test_poses_of_unknown_sigma_do_not_count() -> None:
    sigma = np.full((len(STAMPS), 6), np.nan)
    assert inside_95(estimated(0.02), TRUTH, sigma) is None
    sigma[:10] = 1.0
    found = inside_95(estimated(0.02), TRUTH, sigma)
    assert found is not None and (found.poses, found.height) == (10, 1.0)
    with pytest.raises(UserError, match="sigmas of shape"):
        inside_95(estimated(0.02), TRUTH, sigma[:5])
