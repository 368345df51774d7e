"""What the tests of all elements share: how rays scatter about a surface, when a hypothesis is believed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgslam.as_built.elements.rays import CELL, NORMAL_STEPS, View
from sgslam.as_built.elements.tolerance_classes import Compliance, compliance
from sgslam.config.sensor import CARRIER, SENSOR

Floats = NDArray[np.float64]
UPRIGHT = 1 / NORMAL_STEPS  # of a unit normal, its largest component along z
_LEAST_SPAN = 1.0  # m along a surface, below which a turn says nothing of it
Verdict = Literal["as planned", "moved", "absent", "not seen", "uncertain"]
Progress = Literal["installed", "not found", "not enough data", "occluded", "no data"]
LEAST_VIEWS, LEAST_CELLS = 3, 6  # keyframes, and cells of 0.25 m, that say anything of an element
BEFORE, THROUGH, SPREAD = 0.2, 0.03, 0.05  # of the sightings of a surface: things before it, gaps in it, outliers
DEPTH = 5.0  # m over which what is met elsewhere than at a surface is spread
SURE = float(np.log(100.0))  # log-likelihood of the evidence by which one hypothesis must lead


class Limits(NamedTuple):
    """Metres: the largest offset that counts as planned, the `tolerance`, and the standard deviation of the error that
    all sightings of an element share."""

    tolerance: float
    shared: float


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
) -> Turn | None:
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


def bell(x: Floats, sigma: float = SENSOR.range_noise) -> Floats:
    """The density (1/m) of a Gaussian error of `x` metres."""
    return np.asarray(np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)))


def densest(values: Floats, tries: Floats) -> float:
    """Of some places to `tries` (M,), m, the one about which most of the values (N,) lie."""
    return float(tries[np.argmax(np.exp(-0.5 * ((values - tries[:, None]) / SENSOR.range_noise) ** 2).sum(axis=1))])


def crossing_blur(
    views: Sequence[View], view: NDArray[np.int64], along: Floats, crossed: Floats, measured: Floats
) -> Floats:
    """(N,) metres, how exactly the place `along` (3,) a surface is known at which rays, measured to (N,), cross it at
    `crossed` (N,).

    What a ray meets is known best: its points are put at one instant, so only their ends are where they were measured.
    """
    position = np.array([np.linalg.norm(own.sigma * along) for own in views])[view]
    heading = np.nan_to_num([own.sigma_heading for own in views], posinf=0.0)[view]
    beyond = CARRIER.sweep * np.clip(1 - crossed / np.maximum(measured, 1e-6), 0.0, 1.0)
    return np.asarray(np.sqrt(position**2 + (heading * crossed) ** 2 + beyond**2))


def pose_noise(views: Sequence[View], direction: Floats) -> PoseNoise:
    """The median noise of the poses of these keyframes, their positions' along a unit vector (3,)."""
    noise = [(float(np.linalg.norm(view.sigma * direction)), view.sigma_heading) for view in views]
    position, heading = np.median(noise, axis=0).tolist()
    return PoseNoise(position, heading, len(views))


def judged(offset: float, sigma: float, doubt: bool, tolerance: float) -> tuple[Verdict, Compliance]:
    """The verdict on an offset (m) with its standard deviation, and whether it is within the tolerance.

    The likelier verdict; none where the measurement is coarser than the tolerance, unless the offset exceeds it by one
    standard deviation, and none on an offset beyond it where there is `doubt` that the element is what was measured.
    The report has the same rule, as `judged` in report_tolerance.js.
    """
    outside = abs(offset) > tolerance
    if (doubt and outside) or (sigma > tolerance and abs(offset) < tolerance + sigma):
        return "uncertain", "not conclusive"
    return ("moved" if outside else "as planned"), compliance(offset, sigma, tolerance)


def too_little(cells: int, views: int) -> str:
    """Why an element is not seen: the reason for the reader."""
    needed = f"{LEAST_CELLS} and {LEAST_VIEWS} are needed"
    return f"too little of it was seen: {cells} cells of {1000 * CELL:.0f} mm from {views} keyframes; {needed}"


@dataclass(frozen=True)
class Finding:
    """What the sightings of an element say; the fields as in `ElementVerdict`. `progress` and `coverage` are known once
    those of all elements are."""

    verdict: Verdict
    reason: str
    offset: float | None = None
    direction: tuple[float, float, float] | None = None
    sigma: float | None = None
    turn: Turn | None = None
    tolerance: Compliance | None = None
    seen: float = 0.0
    views: int = 0
    doubt: bool = False
    progress: Progress = "no data"
    coverage: float = 0.0
