"""How good a registration is: good, degraded in some directions, or lost."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.registration.window import Solved
from sgslam.types import Health

Floats = NDArray[np.float64]


def innovation(solved: Solved) -> float:
    """Squared Mahalanobis distance of the last knot from the one that the motion prior predicted, of 6 dimensions."""
    off = np.empty(6)
    turned = solved.knots[-1, :3, :3] @ solved.predicted[-1, :3, :3].T
    off[:3] = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    off[3:] = solved.knots[-1, :3, 3] - solved.predicted[-1, :3, 3]
    prior = np.linalg.inv(solved.information - solved.measured)[-6:, -6:]
    return float(off @ np.linalg.solve(prior, off))


def judged(
    solved: Solved, covariance: Floats, relative: float, was_lost: bool, settings: TrackingSettings
) -> tuple[Health, Floats]:
    """The health of a scan with a covariance (6, 6), rotation first, and with a share of points on known surfaces that
    is so many times the usual one; and the unit twists (M, 6) that are not constrained. A sensor that was lost must fit
    better, and be constrained in all directions: of the many poses that are tried then, some fit by chance."""
    unlike = relative < (settings.suspicious if was_lost else settings.lost) or solved.agreement < settings.agreement
    if unlike or innovation(solved) > settings.innovation:
        return "lost", np.empty((0, 6))
    weak = []
    for part, most in ((0, settings.degraded_rotation), (3, settings.degraded_translation)):
        variances, axes = np.linalg.eigh(covariance[part : part + 3, part : part + 3])
        for axis in axes.T[variances > most**2]:
            twist = np.zeros(6)
            twist[part : part + 3] = axis
            weak.append(twist)
    if not weak:
        return "good", np.empty((0, 6))
    return ("lost", np.empty((0, 6))) if was_lost else ("degraded", np.stack(weak))
