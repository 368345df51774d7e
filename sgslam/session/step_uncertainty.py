"""How uncertain the motion between two keyframes is."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_DOUBLED = 2.0  # variance relative to that of other odometries' steps, from which on a step is weak


class StepUncertainty(Stateful):
    """Compares the covariances (6, 6) of the poses of one keyframe after another: rotation first, sensor axes.

    The covariance of a pose against the odometry's map grows while nothing constrains it, along a bare corridor, and
    shrinks where it is found again: the step is as uncertain as the two differ, besides what every step errs. While no
    surface shows the height, a step in the ground shows as little.
    """

    _STATE = ("_last", "_told")

    def __init__(self, config: Config) -> None:
        settings = config.odometry
        self._ground, self._sway = settings.uneven_ground, config.tracking.sway
        own = settings.sigma_rotation, settings.sigma_translation
        other = settings.other_sigma_rotation, settings.other_sigma_translation
        self._other = np.repeat(other, 3)
        self._base = np.repeat(own, 3) if settings.method == "continuous_time" else self._other
        self._last: Floats | None = None
        self._told: Floats | None = None  # since the last keyframe, where an external odometry told it

    def tell(self, step_covariance: Floats, R_sensor_before: Floats) -> None:
        """Adds the covariance (6, 6) of the motion since the scan before, in the sensor's axes, as an external odometry
        tells it; (3, 3) turns the axes of the scan before into the sensor's."""
        turn = np.kron(np.eye(2), R_sensor_before)
        before = np.zeros((6, 6)) if self._told is None else turn @ self._told @ turn.T
        self._told = np.asarray(before + step_covariance)

    def leave(self, covariance: Floats, up: Floats, way: float, external: bool) -> tuple[Floats, bool]:
        """Goes on to a keyframe: the covariance (6, 6) of the step to it, and whether it is weak.

        `up` (3,) is in the sensor's axes, `way` (m) the length of the step. `external`: an external odometry gave its
        pose.
        """
        base = self._other if external else self._base
        before, self._last = self._last, covariance
        told, self._told = np.zeros((6, 6)) if self._told is None else self._told, None
        if before is None:
            return np.diag(base**2), False
        rises = np.zeros(6) if external else np.append(np.zeros(3), up) * self._rise(covariance, up, way)
        variances, axes = np.linalg.eigh((covariance - before + told) / np.outer(self._other, self._other))
        root = self._other[:, None] * axes * np.sqrt(np.abs(variances))
        found = np.diag(base**2) + root @ root.T + np.outer(rises, rises)
        return np.asarray(found), bool(np.abs(variances).max() > _DOUBLED)

    def _rise(self, covariance: Floats, up: Floats, way: float) -> float:
        """The standard deviation (m) by which the ground may rise unseen: the whole one where the height is known no
        better than a hand sways, less where surfaces show it."""
        unseen = min(float(up @ covariance[3:, 3:] @ up) / self._sway**2, 1.0)
        return self._ground * float(np.sqrt(way * unseen))
