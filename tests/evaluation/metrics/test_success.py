"""Limits on a place, pieces of a way, and the error at surveyed points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data.trajectory import Trajectory
from evaluation.studies.real.success import COARSE, FINE, aligned_rmse, piece_of_each, place_errors

STAMPS = np.arange(40, dtype=np.int64) * 100_000_000


def way() -> Trajectory:
    """A way of 3.9 m round a bend, a step of 0.1 m each tenth of a second."""
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:20, 0, 3], poses[20:, 0, 3] = np.arange(20) * 0.1, 1.9
    poses[20:, 1, 3] = np.arange(1, 21) * 0.1
    return Trajectory(STAMPS, poses)


def moved(metres: float, degrees: float) -> Trajectory:
    poses = way().poses.copy()
    poses[:, 2, 3] += metres
    poses[:, :3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return Trajectory(STAMPS, poses)


@pytest.mark.parametrize(
    ("metres", "degrees", "coarse", "fine"),
    [(0.29, 0.99, 1, 1), (0.31, 0, 1, 0), (0, 1.01, 1, 0), (2.99, -4.99, 1, 0), (3.01, 0, 0, 0), (0, 5.01, 0, 0)],
)
def test_a_place_is_right_within_both_limits(metres: float, degrees: float, coarse: int, fine: int) -> None:
    errors = place_errors(moved(metres, degrees), way())
    assert errors.position_m == pytest.approx(abs(metres)) and np.degrees(errors.yaw_rad) == pytest.approx(abs(degrees))
    assert (errors.within(COARSE).mean(), errors.within(FINE).mean()) == (coarse, fine)


def test_poses_without_a_true_one_have_no_error() -> None:
    later = Trajectory(STAMPS + 20_000_000, way().poses)
    assert len(place_errors(later, way()).position_m) == 0


def test_a_way_is_cut_into_pieces_of_one_length_and_the_rest_is_left_out() -> None:
    pieces = piece_of_each(way(), 1.5)
    assert pieces[[0, 14, 16, 29]].tolist() == [0, 0, 1, 1] and set(pieces[31:]) == {-1}
    assert set(piece_of_each(way(), 4.0)) == {-1}


def test_the_error_at_surveyed_points_knows_where_on_the_carrier_they_are() -> None:
    estimate, point = moved(0.0, 90.0), np.array([0.2, 0.0, 0.3])
    turn = Rotation.from_euler("xyz", [10, 20, 30], degrees=True)
    poses = np.tile(np.eye(4), (40, 1, 1))
    places = (estimate.poses @ np.append(point, 1.0))[:, :3]
    poses[:, :3, 3] = turn.apply(places) + np.array([1000.0, 900.0, 0.0])
    surveyed = Trajectory(STAMPS, poses).only(np.arange(40) % 6 == 0)
    assert aligned_rmse(estimate, surveyed, point) == pytest.approx(0.0, abs=1e-9)
    sparse = estimate.only(np.isin(np.arange(40), (0, 39)))
    assert aligned_rmse(sparse, surveyed, point) != pytest.approx(0.0, abs=0.05)
    assert aligned_rmse(estimate, surveyed.only(np.arange(7) < 2), point) is None
    assert aligned_rmse(estimate, Trajectory(STAMPS + 10**12, poses), point) is None
