"""Noise models for planes and poses, with checks that GTSAM leaves out."""

import gtsam
import numpy as np
from numpy.typing import NDArray


def noise_of_plane(sigma_normal: float, sigma_offset: float, huber: float | None) -> gtsam.noiseModel.Base:
    """Returns a noise model for a plane's residual: two angles of the normal (rad), then the offset (m).

    `huber` is the threshold on the whitened residual; None gives a Gaussian model. Raises ValueError for sigmas and
    thresholds that are not positive and finite (GTSAM accepts most of them and then returns NaN).
    """
    return robust(diagonal([sigma_normal, sigma_normal, sigma_offset]), huber)


def noise_of_pose(sigma_rotation: float, sigma_translation: float, huber: float | None = None) -> gtsam.noiseModel.Base:
    """Returns a noise model for a Pose3 residual: rotation (rad) first, then translation (m).

    `huber` is the threshold on the whitened residual; None gives a Gaussian model. Raises ValueError as
    `noise_of_plane`.
    """
    return robust(diagonal([sigma_rotation] * 3 + [sigma_translation] * 3), huber)


def redescending_noise_of_plane(sigma_normal: float, sigma_offset: float, scale: float) -> gtsam.noiseModel.Robust:
    """Returns a noise model for a plane's residual with the Geman-McClure loss (1987), which suppresses outliers.

    At a whitened residual of `scale`, the weight is a quarter. Start near the optimum: far from it, all gradients
    vanish. Raises ValueError as `noise_of_plane`.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be positive and finite, not {scale}")
    loss = gtsam.noiseModel.mEstimator.GemanMcClure.Create(scale)
    return gtsam.noiseModel.Robust.Create(loss, diagonal([sigma_normal, sigma_normal, sigma_offset]))


def noise_of_covariance(covariance: NDArray[np.float64], huber: float | None = None) -> gtsam.noiseModel.Base:
    """Returns a noise model for a Pose3 residual with a covariance (6, 6): rotation (rad) first, then translation (m).

    `huber` as in `noise_of_pose`. Raises ValueError unless the covariance is finite, symmetric and positive definite.
    """
    value = np.asarray(covariance, dtype=float)
    if value.shape != (6, 6) or not np.isfinite(value).all() or not np.allclose(value, value.T):
        raise ValueError(f"a covariance must be a finite symmetric array (6, 6), not one of shape {value.shape}")
    if np.linalg.eigvalsh(value)[0] <= 0:
        raise ValueError("a covariance must be positive definite")
    return robust(gtsam.noiseModel.Gaussian.Covariance(value), huber)


def diagonal(sigmas: list[float]) -> gtsam.noiseModel.Diagonal:
    """Returns a model with these standard deviations; raises ValueError as `noise_of_plane`."""
    if not (np.all(np.isfinite(sigmas)) and min(sigmas) > 0):
        raise ValueError(f"sigmas must be positive and finite, not {sigmas}")
    return gtsam.noiseModel.Diagonal.Sigmas(np.asarray(sigmas, dtype=float))


def robust(noise: gtsam.noiseModel.Gaussian, huber: float | None) -> gtsam.noiseModel.Base:
    """Returns the model with Huber's loss, unless that is None; raises ValueError as `noise_of_plane`."""
    if huber is None:
        return noise
    if not (np.isfinite(huber) and huber > 0):
        raise ValueError(f"huber must be positive and finite, not {huber}")
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), noise)
