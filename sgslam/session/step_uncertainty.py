"""How uncertain the motion between two keyframes is, beyond the default, where nothing constrained it."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_DOUBLED = 2.0  # variance relative to that of a default step, from which on a step gets a covariance of its own


class StepUncertainty(Stateful):
    """Compares the covariances (6, 6) of the poses of one keyframe after another: rotation first, sensor axes.

    The covariance of a pose against the odometry's map grows while nothing constrains it, along a bare corridor, and
    shrinks where it is found again: the step is as uncertain as the two differ.
    """

    _STATE = ("_last",)

    def __init__(self, odometry: OdometrySettings) -> None:
        self._base = np.array([odometry.sigma_rotation] * 3 + [odometry.sigma_translation] * 3)
        self._last: Floats | None = None

    def leave(self, covariance: Floats) -> Floats | None:
        """Goes on to a keyframe: the covariance (6, 6) of the step to it in excess of the default.

        None where there is no excess worth a factor.
        """
        before, self._last = self._last, covariance
        if before is None:
            return None
        whitened = (covariance - before) / np.outer(self._base, self._base)
        variances, axes = np.linalg.eigh(whitened)
        variances = np.abs(variances)
        if variances.max() < _DOUBLED:
            return None
        root = self._base[:, None] * axes * np.sqrt(variances)
        return np.asarray(root @ root.T)
