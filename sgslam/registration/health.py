"""How good a registration is: the sensor is tracked, not constrained in some directions, or lost."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.registration.relocation import shares_seen_through
from sgslam.registration.window import Solved
from sgslam.surfels import Surfels
from sgslam.types import Health

Floats = NDArray[np.float64]
SUSPICIOUS = 0.85  # times the usual share of explained points; below, a scan is tried again, a lost one stays lost
_LOST = 0.4  # times the usual share; 0.5 at a step of 0.7 m into unknown space
_AGREEMENT = 0.7  # share of the points near a surface that it explains; 0.9 in clutter
_INNOVATION = 60.0  # squared Mahalanobis distance from the prediction; chi-squared, 6 degrees of freedom
_MOST_RAYS = 0.5  # share that no person who went away leaves free, since he stood on one side of the sensor


def fits(solved: Solved, usual: float) -> bool:
    """Whether about as large a share of the newest scan's points as is `usual` lie on known surfaces."""
    return solved.share >= SUSPICIOUS * usual and solved.agreement >= _AGREEMENT


def innovation(solved: Solved) -> float:
    """Squared Mahalanobis distance of the last knot from the one that the motion prior predicted, of 6 dimensions."""
    off = np.empty(6)
    turned = solved.knots[-1, :3, :3] @ solved.predicted[-1, :3, :3].T
    off[:3] = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    off[3:] = solved.knots[-1, :3, 3] - solved.predicted[-1, :3, 3]
    return float(off @ solved.predicted_information[-1] @ off)


def judged(
    solved: Solved, covariance: Floats, relative: float, was_lost: bool, settings: TrackingSettings
) -> tuple[Health, Floats]:
    """The health of a scan with a covariance (6, 6), rotation first, as its points are weighted, and with a share of
    points on known surfaces that is so many times the usual one; and the unit twists (M, 6) that are not constrained.

    A sensor that was lost must fit better, and be constrained in all directions: of the many poses that are tried then,
    some fit by chance.
    """
    unlike = relative < (SUSPICIOUS if was_lost else _LOST) or solved.agreement < _AGREEMENT
    if unlike or innovation(solved) > _INNOVATION:
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


def sees_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float, settings: TrackingSettings) -> bool:
    """Whether the rays from a sensor (3,) to points (N, 3), in `odom`, pass through too many surfaces of the map: its
    pose is wrong, or people who stood there went away."""
    of_rays, of_surfaces = shares_seen_through(points, sensor, surfels, oldest)
    return of_rays > _MOST_RAYS or of_surfaces > settings.seen_through
