"""Errors of tracking: those that were put in are found, and what does not matter changes nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.tracking import errors_over_time, step_errors

MS = 1_000_000
Array = NDArray[np.float64]


def motion(turn_deg: tuple[float, float, float], *move: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    T[:3, 3] = move or (0.0, 0.0, 0.0)
    return T


def walk(count: int = 40, every_ms: int = 100) -> Trajectory:
    """A tilting walk in six degrees of freedom."""
    poses = [motion((5.0, 3.0, 40.0), 3.0, -2.0, 1.2)]
    for k in range(count - 1):
        poses.append(poses[-1] @ motion((2 * np.sin(k), 1.0, 4.0), 0.1, 0.02 * np.cos(k), 0.01))
    return Trajectory(np.arange(count, dtype=np.int64) * every_ms * MS, np.stack(poses))


def slipped(truth: Trajectory, at: int, slip: Array) -> Trajectory:
    """The trajectory in another frame, with one wrong step."""
    poses = truth.poses.copy()
    poses[at:] = poses[at - 1] @ slip @ np.linalg.inv(poses[at - 1]) @ poses[at:]
    return Trajectory(truth.stamps_ns, motion((10.0, -20.0, 70.0), 5.0, 6.0, 7.0) @ poses)


def test_a_true_motion_in_another_frame_has_no_error() -> None:
    truth = walk()
    same = slipped(truth, 20, np.eye(4))
    for found in (errors_over_time(same, truth), step_errors(same, truth)):
        assert found.translation_m.max() < 1e-9 and found.rotation_rad.max() < 1e-9
    assert len(errors_over_time(same, truth).pairs) == len(truth) - 10


def test_a_slip_is_in_one_step_and_in_the_pairs_that_span_it() -> None:
    truth = walk()
    moved = slipped(truth, 20, motion((0.0, 0.0, 0.0), 0.3, 0.0, 0.4))
    steps = step_errors(moved, truth)
    assert np.argmax(steps.translation_m) == 19 and steps.translation_m[19] == pytest.approx(0.5)
    assert np.delete(steps.translation_m, 19).max() < 1e-9
    second = errors_over_time(moved, truth)
    assert (second.translation_m > 0.4).sum() == 10 and np.median(second.translation_m) < 1e-9
    turned = errors_over_time(slipped(truth, 20, motion((0.0, 6.0, 8.0))), truth)
    assert np.degrees(turned.rotation_rad.max()) == pytest.approx(10.0)


def test_a_small_and_a_large_turn_are_told_exactly() -> None:
    truth = walk()
    for degrees in (1e-5, 179.0):
        found = step_errors(slipped(truth, 5, motion((degrees, 0.0, 0.0))), truth)
        assert np.degrees(found.rotation_rad.max()) == pytest.approx(degrees, rel=1e-4)


def test_missing_poses_leave_the_pairs_that_are_a_second_apart() -> None:
    truth = walk()
    kept = np.delete(np.arange(len(truth)), [12, 13, 14])
    found = errors_over_time(Trajectory(truth.stamps_ns[kept], truth.poses[kept]), truth)
    assert len(found.pairs) == len(truth) - 10 - 6
    assert set(np.diff(truth.stamps_ns[kept][found.pairs], axis=1).ravel().tolist()) == {1000 * MS}
    later = Trajectory(truth.stamps_ns[:-1] + 50 * MS, truth.at(truth.stamps_ns[:-1] + 50 * MS))
    assert step_errors(later, truth).translation_m.max() < 1e-9


def test_a_drive_that_is_too_short_is_told() -> None:
    short = walk(5)
    with pytest.raises(UserError, match="5 poses lie 1 s apart"):
        errors_over_time(short, short)
    with pytest.raises(UserError, match="1 poses"):
        step_errors(Trajectory(short.stamps_ns[:1], short.poses[:1]), short)
