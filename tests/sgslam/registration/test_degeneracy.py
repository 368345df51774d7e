"""Information that errors of the normals feign is taken away smoothly."""

import numpy as np
import pytest

from sgslam.registration.degeneracy import project_out_feigned


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(("feigned", "kept"), [(0.0, 1.0), (25.0, 0.75), (99.0, 0.01), (100.0, 0.0), (400.0, 0.0)])
def test_as_much_is_taken_as_is_feigned(axis: int, feigned: float, kept: float) -> None:
    information, F = np.array([50.0, 60.0, 70.0, 900.0, 800.0, 100.0]), np.zeros((6, 6))
    information[axis], F[axis, axis] = 100.0, feigned
    H, g, expected = np.diag(information), np.ones(6), np.ones(6)
    project_out_feigned(H, g, F, 1.0)
    expected[axis] = kept
    assert np.diag(H) == pytest.approx(information * expected, abs=1e-4)
    assert g == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_remains_is_no_less_than_nothing_no_more_than_there_was_and_of_any_unit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, scale = rng.normal(size=(40, 18)), rng.normal(size=(20, 6)), np.diag([100.0, 100, 100, 1, 1, 1])
    knots = np.kron(np.eye(3), scale)
    H, g = A.T @ A, rng.normal(size=18)
    before, scaled, other = H.copy(), knots @ H @ knots, knots @ g
    project_out_feigned(H, g, B.T @ B, 3.0)
    project_out_feigned(scaled, other, scale @ B.T @ B @ scale, 3.0)
    for part in (H, (before - H).reshape(3, 6, 3, 6).sum(axis=(0, 2))):  # and about a motion of all knots
        assert np.allclose(part, part.T) and np.linalg.eigvalsh(part).min() > -1e-9
    assert scaled == pytest.approx(knots @ H @ knots, rel=1e-4, abs=1e-3)
    assert other == pytest.approx(knots @ g, rel=1e-3, abs=1e-3)


def test_where_the_points_tell_something_it_stays_what_they_tell() -> None:
    rng = np.random.default_rng(0)
    A, F = rng.normal(size=(40, 6)), np.diag([0.0, 0, 0, 0, 0, 9.0])
    H, g = A.T @ A, rng.normal(size=6)
    told = np.linalg.solve(H, g)
    project_out_feigned(H, g, F, 1.0)
    assert np.linalg.solve(H, g) == pytest.approx(told, abs=1e-6)
