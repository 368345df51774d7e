"""Trajectory metrics: evo's numbers, cases that can be computed by hand, invariances, and what is refused."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.consistency import nees
from evaluation.metrics.trajectories import SUB_LENGTHS_M, ape, drift, error_in_bim, rpe

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


@pytest.mark.parametrize("step", [0.25, 0.1])
def test_rpe_is_evos_also_at_even_steps_with_stops(evo: Any, step: float) -> None:
    at = np.repeat(np.arange(60) * step, np.arange(60) % 4 + 1)  # pairs at, beside and half way to a length
    truth = stamped(poses(np.outer(at, [1, 0, 0]), Rotation.identity(len(at))))
    metrics = evo.core.metrics
    deltas = [(truth, truth, k * step) for k in (1, 2, 5.5, 10)] + [(ESTIMATE, TRUTH, k * step) for k in (3, 40)]
    for estimate, true, delta in deltas:
        theirs = metrics.RPE(delta=delta, delta_unit=metrics.Unit.meters, all_pairs=True, pairs_from_reference=True)
        theirs.process_data(evo_pair(evo, estimate, true))
        result = rpe(estimate, true, delta)
        assert result.pairs[:, 1].tolist() == theirs.delta_ids
        assert np.allclose(result.translation_m, theirs.error, atol=1e-6, rtol=0)


def test_the_frame_does_not_change_errors_after_alignment() -> None:
    assert error_in_bim(TRUTH.transformed(motion(5)), TRUTH).position.rmse > 1
    for alignment in ("se3", "origin"):
        before = ape(ESTIMATE, TRUTH, alignment)  # type: ignore[arg-type]
        after = ape(ESTIMATE.transformed(motion(5)), TRUTH.transformed(motion(6)), alignment)  # type: ignore[arg-type]
        assert np.allclose(before.translation_m, after.translation_m, atol=1e-9)
        exact = ape(TRUTH.transformed(motion(5)), TRUTH, alignment)  # type: ignore[arg-type]
        assert np.allclose(exact.T_truth_estimate @ motion(5), np.eye(4), atol=1e-9)
    one, other = (rpe(ESTIMATE.transformed(motion(k)), TRUTH.transformed(motion(k + 1)), 2.0) for k in (1, 7))
    assert np.allclose(one.translation_m, other.translation_m) and one.pairs.tolist() == other.pairs.tolist()
    moved = drift(ESTIMATE.transformed(motion(8)), TRUTH)
    assert moved.end_percent == pytest.approx(drift(ESTIMATE, TRUTH).end_percent)


def test_refusals_say_what_is_wrong() -> None:
    straight = line([1, 0, 0])
    for estimate, truth, message in (
        (straight.transformed(motion(1, about_z=True)), straight, "straight line"),
        (line([0, 0, 0]), straight, "too little motion"), (line([1, 0, 0], 1), line([1, 0, 0], 1), "1 matched poses"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=message):
            ape(estimate, truth, "se3")
    late = Trajectory(TRUTH.stamps_ns + 10**12, TRUTH.poses)
    for metric in (rpe, drift, error_in_bim):
        with pytest.raises(UserError, match="clocks"):
            metric(late, TRUTH)
    with pytest.raises(UserError, match="no two poses lie 500 m apart"):
        rpe(TRUTH, TRUTH, 500.0)
    for delta in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(UserError, match="positive"):
            rpe(TRUTH, TRUTH, delta)
    with pytest.raises(UserError, match="no way"):
        drift(line([0, 0, 0]), line([0, 0, 0]))
    with pytest.raises(UserError, match="no two poses"):
        rpe(line([1, 0, 0], 1), line([1, 0, 0], 1))


def test_errors_in_the_bim_frame_by_their_parts() -> None:
    T = motion(0, about_z=True)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0, 0, 0.02]).as_matrix(), [0.3, 0.4, -1.2]
    flat = stamped(poses(np.zeros((20, 3)), Rotation.from_rotvec(np.outer(np.linspace(0, 2, 20), [0, 0, 1]))))
    result = error_in_bim(flat.transformed(T), flat)
    assert result.horizontal.rmse == pytest.approx(0.5) and result.height.rmse == pytest.approx(1.2)
    assert result.position.max == pytest.approx(1.3)
    assert result.yaw.median == pytest.approx(0.02)


def test_drift_of_a_scale_error_is_that_error_at_all_lengths() -> None:
    result = drift(line([1.02, 0, 0], 1001), line([1, 0, 0], 1001))
    assert result.travelled_m == pytest.approx(100) and result.end_percent == pytest.approx(2)
    # KITTI ends at the first pose beyond the length and divides by the length: up to one step of 0.1 m too much.
    assert result.mean_percent is not None and 2 <= result.mean_percent <= 2 * (1 + 0.1 / SUB_LENGTHS_M[0]) + 1e-9
    short = drift(line([1.1, 0, 0], 20), line([1, 0, 0], 20))  # shorter than all lengths
    assert short.end_percent == pytest.approx(10) and short.mean_percent is None


def noisy(covariance: Array, count: int = 400) -> tuple[Trajectory, Trajectory]:
    """An estimate whose true poses scatter about it by a covariance in its own axes, rotation first."""
    truth = wander(count)
    e = np.random.default_rng(4).multivariate_normal(np.zeros(6), covariance, count)
    # The translation of Exp(e) is V rho; for such small turns V is the identity to 1e-4 of rho.
    error = poses(e[:, 3:] + 0.5 * np.cross(e[:, :3], e[:, 3:]), Rotation.from_rotvec(e[:, :3]))
    return Trajectory(truth.stamps_ns, truth.poses @ np.linalg.inv(error)), truth


def test_nees_knows_right_covariances_from_wrong_ones() -> None:
    half = np.random.default_rng(0).normal(size=(6, 6)) * np.array([[0.01] * 3 + [0.05] * 3]).T
    covariance = half @ half.T + 1e-6 * np.eye(6)
    estimate, truth = noisy(covariance)
    right = nees(estimate, truth, np.tile(covariance, (400, 1, 1)))
    assert right == pytest.approx(1, abs=0.057)  # 1.96 sqrt(2 / 2400)
    assert nees(estimate, truth, np.tile(covariance * 0.25, (400, 1, 1))) == pytest.approx(4 * right)
    assert nees(estimate, truth, np.tile(covariance * 4.0, (400, 1, 1))) == pytest.approx(right / 4)
    swapped = np.roll(np.tile(covariance, (400, 1, 1)), 3, axis=(1, 2))  # translation first is another convention
    assert nees(estimate, truth, swapped) > 1.057


def test_nees_pairs_covariances_with_the_poses_that_match() -> None:
    estimate, truth = noisy(np.eye(6) * 1e-4)
    covariances = np.eye(6) * (1e-4 * np.arange(1, 401))[:, None, None]
    part = nees(estimate, Trajectory(truth.stamps_ns[100:200], truth.poses[100:200]), covariances)
    own = (Trajectory(t.stamps_ns[100:200], t.poses[100:200]) for t in (estimate, truth))
    assert part == pytest.approx(nees(*own, covariances[100:200]))


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.zeros((6, 6)), "pose 0 is not positive definite"),
        (np.diag([1, 1, 1, 1, 1, -1.0]), "not positive definite"),
        (np.eye(6) + np.eye(6, k=1) * 0.1, "symmetric"),
        (np.eye(6) * np.nan, "not finite"),
        (np.eye(3), "shape"),
    ],
)
def test_nees_refuses_what_is_no_covariance(covariance: Array, message: str) -> None:
    with pytest.raises(UserError, match=message):
        nees(TRUTH, TRUTH, np.tile(covariance, (len(TRUTH), 1, 1)))
