"""Trajectory metrics: evo's numbers, cases that can be computed by hand, invariances, and what is refused."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.trajectories import ape, error_in_bim, inside_95, wrong_poses

MS = 1_000_000
T0 = 1_700_000_000_000_000_000
Array = NDArray[np.float64]


def poses(positions: Array, rotations: Rotation) -> Array:
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = rotations.as_matrix(), positions
    return T


def stamped(T: Array) -> Trajectory:
    return Trajectory(T0 + np.arange(len(T)) * 100 * MS, T)


def wander(count: int = 300, seed: int = 0) -> Trajectory:
    """A smooth way through space, about 0.2 m a step, that stands still for a while."""
    rng = np.random.default_rng(seed)
    step = np.cumsum(rng.normal(size=(count, 3)), axis=0)
    step = 0.2 * step / np.linalg.norm(step, axis=1, keepdims=True) * rng.uniform(0.5, 1.5, (count, 1))
    step[count // 2 : count // 2 + 15] = 0
    turns = np.cumsum(rng.normal(scale=0.05, size=(count, 3)), axis=0)
    return stamped(poses(np.cumsum(step, axis=0), Rotation.from_rotvec(turns)))


def drifting(truth: Trajectory, seed: int = 1, metres: float = 0.01, radians: float = 0.004) -> Trajectory:
    """The same motion with an error in each step."""
    rng = np.random.default_rng(seed)
    steps = np.linalg.inv(truth.poses[:-1]) @ truth.poses[1:]
    noise = poses(
        rng.normal(scale=metres, size=(len(steps), 3)), Rotation.from_rotvec(rng.normal(0, radians, (len(steps), 3)))
    )
    T = [truth.poses[0]]
    for step in steps @ noise:
        T.append(T[-1] @ step)
    return Trajectory(truth.stamps_ns, np.array(T))


def motion(seed: int, about_z: bool = False) -> Array:
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(1, 3)) * ([0, 0, 1] if about_z else [1, 1, 1])
    return poses(rng.normal(scale=20, size=(1, 3)), Rotation.from_rotvec(turn))[0]


def line(direction: list[float], count: int = 101) -> Trajectory:
    return stamped(poses(np.outer(np.arange(count) * 0.1, direction), Rotation.identity(count)))


TRUTH = wander()
ESTIMATE = drifting(TRUTH)


@pytest.fixture(scope="module")
def evo() -> Any:
    pytest.importorskip("evo", reason="evo is a development extra")
    import evo.core.metrics
    import evo.core.sync
    import evo.core.trajectory

    return evo


def evo_pair(evo: Any, estimate: Trajectory, truth: Trajectory) -> tuple[Any, Any]:
    both = [
        evo.core.trajectory.PoseTrajectory3D(poses_se3=list(t.poses), timestamps=t.stamps_ns / 1e9)
        for t in (truth, estimate)
    ]
    return evo.core.sync.associate_trajectories(*both, max_diff=0.01)


@pytest.mark.parametrize("alignment", ["none", "se3", "origin"])
def test_ape_is_evos(evo: Any, alignment: Any) -> None:
    estimate = Trajectory(ESTIMATE.stamps_ns[7:] + 3 * MS, ESTIMATE.poses[7:]).transformed(motion(3))
    reference, other = evo_pair(evo, estimate, TRUTH)
    if alignment == "se3":
        other.align(reference)
    if alignment == "origin":
        other.align_origin(reference)
    theirs = evo.core.metrics.APE(evo.core.metrics.PoseRelation.translation_part)
    theirs.process_data((reference, other))
    if alignment == "none":
        statistics = error_in_bim(estimate, TRUTH).position
    else:
        result = ape(estimate, TRUTH, alignment)
        statistics = result.translation
        assert np.allclose(result.translation_m, theirs.error, atol=1e-6, rtol=0)
    for name, value in vars(statistics).items():
        assert value == pytest.approx(theirs.get_all_statistics()[name], abs=1e-6), name
    assert error_in_bim(estimate, TRUTH).matched_poses == reference.num_poses


def test_the_frame_does_not_change_errors_after_alignment() -> None:
    assert error_in_bim(TRUTH.transformed(motion(5)), TRUTH).position.rmse > 1
    for alignment in ("se3", "origin"):
        before = ape(ESTIMATE, TRUTH, alignment)  # type: ignore[arg-type]
        after = ape(ESTIMATE.transformed(motion(5)), TRUTH.transformed(motion(6)), alignment)  # type: ignore[arg-type]
        assert np.allclose(before.translation_m, after.translation_m, atol=1e-9)
        exact = ape(TRUTH.transformed(motion(5)), TRUTH, alignment)  # type: ignore[arg-type]
        assert np.allclose(exact.T_truth_estimate @ motion(5), np.eye(4), atol=1e-9)


def test_refusals_say_what_is_wrong() -> None:
    straight = line([1, 0, 0])
    for estimate, truth, message in (
        (straight.transformed(motion(1, about_z=True)), straight, "straight line"),
        (line([0, 0, 0]), straight, "too little motion"),
        (line([1, 0, 0], 1), line([1, 0, 0], 1), "1 matched poses"),
    ):
        with pytest.raises(UserError, match=message):
            ape(estimate, truth, "se3")
    with pytest.raises(UserError, match="clocks"):
        error_in_bim(Trajectory(TRUTH.stamps_ns + 10**12, TRUTH.poses), TRUTH)


def test_errors_in_the_bim_frame_by_their_parts() -> None:
    T = motion(0, about_z=True)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0, 0, 0.02]).as_matrix(), [0.3, 0.4, -1.2]
    flat = stamped(poses(np.zeros((20, 3)), Rotation.from_rotvec(np.outer(np.linspace(0, 2, 20), [0, 0, 1]))))
    result = error_in_bim(flat.transformed(T), flat)
    assert result.horizontal.rmse == pytest.approx(0.5) and result.height.rmse == pytest.approx(1.2)
    assert result.position.max == pytest.approx(1.3)
    assert result.yaw.median == pytest.approx(0.02)


def test_errors_lie_in_their_95_percent_regions_as_often_as_sigmas_are_true() -> None:
    sigma = np.array([0.02, 0.02, 0.05, 0.01, 0.01, 0.004])
    drawn = np.random.default_rng(2).normal(size=(4000, 6)) * sigma
    truth = line([1, 0, 0], 4000)
    off = poses(truth.positions + drawn[:, :3], Rotation.from_rotvec(drawn[:, 3:]))
    found = Trajectory(truth.stamps_ns, off)
    for factor, least, most in ((1.0, 0.94, 0.96), (0.5, 0.3, 0.8), (2.0, 0.99, 1.0)):
        inside = inside_95(found, truth, np.tile(factor * sigma, (4000, 1)))
        assert inside is not None and inside.poses == 4000
        assert all(least <= share <= most for share in (inside.plan_view, inside.height, inside.yaw))
    unknown = np.tile(sigma, (4000, 1))
    unknown[100:] = np.nan
    known = inside_95(found, truth, unknown)
    assert known is not None and known.poses == 100
    assert inside_95(found, truth, np.full((4000, 6), np.nan)) is None
    with pytest.raises(UserError, match="sigmas of shape"):
        inside_95(found, truth, unknown[1:])


def test_a_pose_is_wrong_beyond_half_a_metre_or_five_degrees() -> None:
    truth, none = line([1, 0, 0], 4), Rotation.identity(4)
    off = poses(truth.positions + np.array([[0.51, 0, 0], [0, 0.49, 0], [0, 0, 0], [0, 0, 0]]), none)
    for row, degrees in ((2, 4.9), (3, 5.1)):
        off[row, :3, :3] = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    assert wrong_poses(Trajectory(truth.stamps_ns, off), truth) == 2
