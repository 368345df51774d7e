"""What a tracker says of its poses: true covariances hold in 95 of 100 motions, too small ones do not."""

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.tracker_claims import inside_region, up_errors, wrongly_good

Array = NDArray[np.float64]
SIGMAS = np.array([0.002, 0.004, 0.001, 0.01, 0.03, 0.02])  # rad, m
STEP = np.array([0.03, -0.02, 0.05, 0.1, 0.02, 0.01])


def stamped(poses: Array) -> Trajectory:
    return Trajectory(np.arange(len(poses), dtype=np.int64) * 100_000_000, poses)


def walk(count: int) -> Trajectory:
    first = gtsam.Pose3.Expmap(np.array([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])).matrix()
    return stamped(np.stack([first @ gtsam.Pose3.Expmap(k * STEP).matrix() for k in range(count)]))


def noisy(truth: Trajectory, seed: int) -> Trajectory:
    """Each pose with an error of its own, in its own axes."""
    drawn = np.random.default_rng(seed).normal(size=(len(truth), 6)) * SIGMAS
    return stamped(np.stack([T @ gtsam.Pose3.Expmap(e).matrix() for T, e in zip(truth.poses, drawn, strict=True)]))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_true_covariances_hold_and_others_do_not(seed: int) -> None:
    truth, good = walk(1500), np.ones(1500, dtype=bool)
    found, covariances = noisy(truth, seed), np.tile(np.diag(SIGMAS**2), (1500, 1, 1))
    shares = [inside_region(found, truth, scale**2 * covariances, good).mean() for scale in (1.0, 0.5, 2.0)]
    assert shares[0] == pytest.approx(0.95, abs=0.03)
    assert shares[1] < 0.5 and shares[2] > 0.99
    good[::2] = False
    assert len(inside_region(found, truth, covariances, good)) == (1500 - 10) // 2


def test_a_lever_counts() -> None:
    """A turn that is not sure makes the place a second later unsure, by the way travelled."""
    truth = stamped(np.stack([gtsam.Pose3(gtsam.Rot3(), [0.5 * k, 0.0, 0.0]).matrix() for k in range(11)]))
    poses = truth.poses.copy()
    poses[0] = poses[0] @ gtsam.Pose3.Expmap(np.array([0.0, 0.0, 0.01, 0.0, 0.0, 0.0])).matrix()
    covariances = np.tile(1e-8 * np.eye(6), (11, 1, 1))
    good = np.ones(11, dtype=bool)
    assert not inside_region(stamped(poses), truth, covariances, good).any()
    covariances[0, 2, 2] = 0.01**2
    assert inside_region(stamped(poses), truth, covariances, good).all()


def test_a_slip_that_is_called_good_is_found() -> None:
    truth, good = walk(30), np.ones(30, dtype=bool)
    poses = truth.poses.copy()
    poses[12:] = gtsam.Pose3(gtsam.Rot3(), [0.3, 0.0, 0.0]).matrix() @ poses[12:]
    assert np.flatnonzero(wrongly_good(stamped(poses), truth, good)).tolist() == [11, 12]
    good[12] = False
    assert np.flatnonzero(wrongly_good(stamped(poses), truth, good)).tolist() == [11]
    assert not wrongly_good(stamped(poses), truth, good, limit_m=0.4).any()


def test_up_is_compared_in_the_sensors_axes() -> None:
    truth = walk(20)
    up = truth.poses[:, 2, :3]
    assert up_errors(up, truth, truth).max() < 1e-9
    tilted = np.stack([gtsam.Rot3.Rx(0.1).matrix() @ own for own in up])
    assert up_errors(tilted, truth, truth).max() <= 0.1 + 1e-9 and up_errors(tilted, truth, truth).max() > 0.05
    assert up_errors(-up, truth, truth) == pytest.approx(np.pi)


def test_covariances_that_are_none_are_told() -> None:
    truth, good = walk(20), np.ones(20, dtype=bool)
    with pytest.raises(UserError, match="20 poses"):
        inside_region(truth, truth, np.zeros((19, 6, 6)), good)
    with pytest.raises(UserError, match="pose 10 is not positive definite"):
        inside_region(truth, truth, np.zeros((20, 6, 6)), good)
