"""Errors of tracking that were put in are found, and what a tracker says of its poses is held against them."""

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.tracking import errors_over_time, inside_region, step_errors, up_errors, wrongly_good

MS = 1_000_000
Array = NDArray[np.float64]
SIGMAS = np.array([0.002, 0.004, 0.001, 0.01, 0.03, 0.02])  # rad, m
STEP = np.array([0.03, -0.02, 0.05, 0.1, 0.02, 0.01])


def motion(*vector: float) -> Array:
    """(4, 4) of a rotation vector (rad) and a translation (m)."""
    return np.asarray(gtsam.Pose3(gtsam.Rot3.Expmap(np.array(vector[:3])), np.array(vector[3:])).matrix())


def stamped(poses: Array) -> Trajectory:
    return Trajectory(np.arange(len(poses), dtype=np.int64) * 100 * MS, poses)


def walk(count: int = 40) -> Trajectory:
    """A tilting walk in six degrees of freedom."""
    first = motion(0.1, 0.2, 0.3, 4.0, 5.0, 6.0)
    return stamped(np.stack([first @ gtsam.Pose3.Expmap(k * STEP).matrix() for k in range(count)]))


def slipped(truth: Trajectory, at: int, slip: Array) -> Trajectory:
    """The trajectory in another frame, with one wrong step."""
    poses = truth.poses.copy()
    poses[at:] = poses[at - 1] @ slip @ np.linalg.inv(poses[at - 1]) @ poses[at:]
    return Trajectory(truth.stamps_ns, motion(0.2, -0.3, 1.2, 5.0, 6.0, 7.0) @ poses)


def test_a_slip_is_in_one_step_and_in_the_pairs_that_span_it() -> None:
    truth = walk()
    same = slipped(truth, 20, np.eye(4))
    for found in (errors_over_time(same, truth), step_errors(same, truth)):
        assert found.translation_m.max() < 1e-9 and found.rotation_rad.max() < 1e-9
    moved = slipped(truth, 20, motion(0, 0, 0, 0.3, 0, 0.4))
    steps, second = step_errors(moved, truth), errors_over_time(moved, truth)
    assert np.argmax(steps.translation_m) == 19 and steps.translation_m[19] == pytest.approx(0.5)
    assert np.delete(steps.translation_m, 19).max() < 1e-9
    assert len(second.pairs) == len(truth) - 10 and (second.translation_m > 0.4).sum() == 10
    for degrees in (1e-5, 10.0, 179.0):
        turned = step_errors(slipped(truth, 5, motion(np.radians(degrees), 0, 0, 0, 0, 0)), truth)
        assert np.degrees(turned.rotation_rad.max()) == pytest.approx(degrees, rel=1e-4)


def test_missing_poses_leave_the_pairs_that_are_a_second_apart() -> None:
    truth = walk()
    kept = np.delete(np.arange(len(truth)), [12, 13, 14])
    found = errors_over_time(Trajectory(truth.stamps_ns[kept], truth.poses[kept]), truth)
    assert len(found.pairs) == len(truth) - 10 - 6
    assert set(np.diff(truth.stamps_ns[kept][found.pairs], axis=1).ravel().tolist()) == {1000 * MS}
    later = Trajectory(truth.stamps_ns[:-1] + 50 * MS, truth.at(truth.stamps_ns[:-1] + 50 * MS))
    assert step_errors(later, truth).translation_m.max() < 1e-9
    short = walk(5)
    with pytest.raises(UserError, match="5 poses lie 1 s apart"):
        errors_over_time(short, short)
    with pytest.raises(UserError, match="1 poses"):
        step_errors(Trajectory(short.stamps_ns[:1], short.poses[:1]), short)


def test_true_covariances_hold_in_95_of_100_motions_and_others_do_not() -> None:
    truth, good = walk(1500), np.ones(1500, dtype=bool)
    drawn = np.random.default_rng(0).normal(size=(1500, 6)) * SIGMAS
    found = stamped(np.stack([T @ gtsam.Pose3.Expmap(e).matrix() for T, e in zip(truth.poses, drawn, strict=True)]))
    covariances = np.tile(np.diag(SIGMAS**2), (1500, 1, 1))
    shares = [inside_region(found, truth, scale**2 * covariances, good).mean() for scale in (1.0, 0.5, 2.0)]
    assert shares[0] == pytest.approx(0.95, abs=0.03) and shares[1] < 0.5 and shares[2] > 0.99
    good[::2] = False
    assert len(inside_region(found, truth, covariances, good)) == (1500 - 10) // 2
    with pytest.raises(UserError, match="1500 poses"):
        inside_region(truth, truth, covariances[1:], good)
    with pytest.raises(UserError, match=r"pose 1\d? is not positive definite"):
        inside_region(truth, truth, 0 * covariances, good)


def test_a_turn_that_is_not_sure_makes_the_place_a_second_later_unsure() -> None:
    truth = stamped(np.stack([motion(0, 0, 0, 0.5 * k, 0, 0) for k in range(11)]))
    poses, good = truth.poses.copy(), np.ones(11, dtype=bool)
    poses[0] = poses[0] @ motion(0, 0, 0.01, 0, 0, 0)
    covariances = np.tile(1e-8 * np.eye(6), (11, 1, 1))
    assert not inside_region(stamped(poses), truth, covariances, good).any()
    covariances[0, 2, 2] = 0.01**2
    assert inside_region(stamped(poses), truth, covariances, good).all()


def test_a_slip_that_is_called_good_is_found() -> None:
    truth, good = walk(30), np.ones(30, dtype=bool)
    poses = truth.poses.copy()
    poses[12:] = motion(0, 0, 0, 0.3, 0, 0) @ poses[12:]
    assert np.flatnonzero(wrongly_good(stamped(poses), truth, good)).tolist() == [11, 12]
    good[12] = False
    assert np.flatnonzero(wrongly_good(stamped(poses), truth, good)).tolist() == [11]
    assert not wrongly_good(stamped(poses), truth, good, limit_m=0.4).any()


def test_up_is_compared_in_the_sensors_axes() -> None:
    truth = walk(20)
    up = truth.poses[:, 2, :3]
    tilted = np.stack([gtsam.Rot3.Rx(0.1).matrix() @ own for own in up])
    assert up_errors(up, truth, truth).max() < 1e-9 and up_errors(-up, truth, truth) == pytest.approx(np.pi)
    assert 0.05 < up_errors(tilted, truth, truth).max() <= 0.1 + 1e-9
