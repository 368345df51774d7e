"""How uncertain the motion between two keyframes is."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings

Floats = NDArray[np.float64]
_DOUBLED = 2.0  # variance relative to that of other odometries' steps, from which on a step is weak


class StepUncertainty:
    """Compares the covariances (6, 6) of the poses of one keyframe after another: rotation first, sensor axes.

    The covariance of a pose against the odometry's map grows while nothing constrains it, along a bare corridor, and
    shrinks where it is found again: the step is as uncertain as the two differ, besides what every step errs.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        self._own = np.repeat([settings.sigma_rotation, settings.sigma_translation], 3)
        self._other = np.repeat([settings.other_sigma_rotation, settings.other_sigma_translation], 3)
        self._last: Floats | None = None
        self._stated: Floats | None = None  # since the last keyframe, where an external odometry states it

    def add(self, step_covariance: Floats, R_sensor_before: Floats) -> None:
        """Adds the covariance (6, 6) of the motion since the scan before, in the sensor's axes, as an external odometry
        states it; (3, 3) turns the axes of the scan before into the sensor's."""
        turn = np.kron(np.eye(2), R_sensor_before)
        before = np.zeros((6, 6)) if self._stated is None else turn @ self._stated @ turn.T
        self._stated = np.asarray(before + step_covariance)

    def leave(self, covariance: Floats, external: bool) -> tuple[Floats, bool]:
        """Goes on to a keyframe: the covariance (6, 6) of the step to it, and whether it is weak.

        `external`: an external odometry gave its pose.
        """
        base = self._other if external else self._own
        before, self._last = self._last, covariance
        stated, self._stated = np.zeros((6, 6)) if self._stated is None else self._stated, None
        if before is None:
            return np.diag(base**2), False
        variances, axes = np.linalg.eigh((covariance - before + stated) / np.outer(self._other, self._other))
        root = self._other[:, None] * axes * np.sqrt(np.abs(variances))
        return np.asarray(np.diag(base**2) + root @ root.T), bool(np.abs(variances).max() > _DOUBLED)
