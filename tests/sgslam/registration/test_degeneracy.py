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


@pytest.mark.parametrize("seed", range(5))
def test_what_remains_is_no_less_than_nothing_and_no_more_than_there_was(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(40, 18)), rng.normal(size=(20, 6))
    H, g = A.T @ A, rng.normal(size=18)
    before = _of_all(H)
    project_out_feigned(H, g, B.T @ B, 3.0)
    assert np.allclose(H, H.T)
    assert np.linalg.eigvalsh(H).min() > -1e-9
    assert np.linalg.eigvalsh(before - _of_all(H)).min() > -1e-9


@pytest.mark.parametrize("seed", range(5))
def test_units_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, scale = rng.normal(size=(40, 6)), rng.normal(size=(20, 6)), np.diag([100.0, 100, 100, 1, 1, 1])
    H, scaled, g = A.T @ A, scale @ A.T @ A @ scale, rng.normal(size=6)
    other = scale @ g
    project_out_feigned(H, g, B.T @ B, 1.0)
    project_out_feigned(scaled, other, scale @ B.T @ B @ scale, 1.0)
    assert scaled == pytest.approx(scale @ H @ scale, rel=1e-4, abs=1e-4)
    assert other == pytest.approx(scale @ g, rel=1e-4)


def test_where_the_points_tell_something_it_stays_what_they_tell() -> None:
    rng = np.random.default_rng(0)
    A, F = rng.normal(size=(40, 6)), np.diag([0.0, 0, 0, 0, 0, 9.0])
    H, g = A.T @ A, rng.normal(size=6)
    told = np.linalg.solve(H, g)
    project_out_feigned(H, g, F, 1.0)
    assert np.linalg.solve(H, g) == pytest.approx(told, abs=1e-6)


def _of_all(H: np.ndarray) -> np.ndarray:
    """The information about a motion of all knots."""
    return H.reshape(3, 6, 3, 6).sum(axis=(0, 2))
