"""How far an upright surface is turned against its planned direction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
UPRIGHT = 0.1  # of a unit normal, its largest component along z
_LEAST_SPAN = 1.0  # m along a surface, below which a turn says nothing of it


@dataclass(frozen=True)
class Turn:
    """`angle` (rad) about the vertical, counter-clockwise from above, with its standard deviation `sigma` (rad)."""

    angle: float
    sigma: float


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of the `views` keyframes that saw a surface: of a position (m), and of the heading (rad)."""

    position: float
    heading: float
    views: int


def turn_of(
    places: Floats, offset: Floats, weight: Floats, normal: Floats, noise: float, poses: PoseNoise
) -> Turn | None:  # fmt: skip
    """The line through what was met of a surface, in plan view; None where the surface is level, was seen over less
    than 1 m, or the headings are not known.

    `places` (N, 3) metres on the planned surface, `offset` (N,) metres along its `normal` (3,), each with standard
    deviation `noise` (m) at `weight` (N,) one.
    """
    if abs(normal[2]) > UPRIGHT or not len(places) or not np.isfinite(poses.heading):
        return None
    along = places[:, :2] @ np.array([-normal[1], normal[0]])
    span = float(np.ptp(along))
    if span < _LEAST_SPAN:
        return None
    along = along - np.average(along, weights=weight)
    spread = float(np.sum(weight * along**2))
    slope = float(np.sum(weight * along * (offset - np.average(offset, weights=weight)))) / spread
    # views that are spread evenly over the span, each with a position of its own: a uniform distribution's deviation
    positions = poses.position * np.sqrt(12.0 / poses.views) / span
    sigma = float(np.linalg.norm([noise / np.sqrt(spread), positions, poses.heading]))
    return Turn(-slope, sigma)
