"""Information that errors of the normals feign is taken away smoothly."""

import numpy as np
import pytest

from sgslam.registration.degeneracy import project_out_feigned


@pytest.mark.parametrize(("feigned", "kept"), [(0.0, 1.0), (25.0, 0.75), (99.0, 0.01), (100.0, 0.0), (400.0, 0.0)])
def test_as_much_is_taken_as_is_feigned(feigned: float, kept: float) -> None:
    H, g, F = np.diag([50.0, 60.0, 70.0, 900.0, 800.0, 100.0]), np.ones(6), np.zeros((3, 3))
    F[2, 2] = feigned
    project_out_feigned(H, g, F, 1.0)
    assert np.diag(H) == pytest.approx([50, 60, 70, 900, 800, 100 * kept])
    assert g == pytest.approx([1, 1, 1, 1, 1, kept])


@pytest.mark.parametrize("seed", range(5))
def test_what_remains_is_no_less_than_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(40, 18)), rng.normal(size=(20, 3))
    H, g = A.T @ A, rng.normal(size=18)
    project_out_feigned(H, g, B.T @ B, 3.0)
    assert np.allclose(H, H.T)
    assert np.linalg.eigvalsh(H).min() > -1e-9
