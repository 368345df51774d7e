"""How uncertain the motion between two keyframes is."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_DOUBLED = 2.0  # variance relative to that of other odometries' steps, from which on a step is weak


class StepUncertainty(Stateful):
    """Compares the covariances (6, 6) of the poses of one keyframe after another: rotation first, sensor axes.

    The covariance of a pose against the odometry's map grows while nothing constrains it, along a bare corridor, and
    shrinks where it is found again: the step is as uncertain as the two differ, besides what every step errs.
    """

    _STATE = ("_last",)

    def __init__(self, settings: OdometrySettings) -> None:
        own = settings.sigma_rotation, settings.sigma_translation
        other = settings.other_sigma_rotation, settings.other_sigma_translation
        self._other = np.repeat(other, 3)
        self._base = np.repeat(own, 3) if settings.method == "continuous_time" else self._other
        self._last: Floats | None = None

    def leave(self, covariance: Floats, external: bool) -> tuple[Floats, bool]:
        """Goes on to a keyframe: the covariance (6, 6) of the step to it, and whether it is weak.

        `external`: an external odometry gave its pose.
        """
        base = self._other if external else self._base
        before, self._last = self._last, covariance
        if before is None:
            return np.diag(base**2), False
        variances, axes = np.linalg.eigh((covariance - before) / np.outer(self._other, self._other))
        root = self._other[:, None] * axes * np.sqrt(np.abs(variances))
        return np.asarray(np.diag(base**2) + root @ root.T), bool(np.abs(variances).max() > _DOUBLED)
