"""What the tests of all elements share: how rays scatter about a surface, and when a hypothesis is believed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sgslam.as_built.elements.entries import Verdict
from sgslam.as_built.elements.rays import View
from sgslam.as_built.elements.sightings import CELL
from sgslam.as_built.elements.tolerance_classes import SURE_SIGMAS
from sgslam.as_built.elements.turns import PoseNoise
from sgslam.config.sensor import CARRIER, SENSOR

Floats = NDArray[np.float64]
LEAST_VIEWS, LEAST_CELLS = 3, 6  # keyframes, and cells of 0.25 m, that say anything of an element
REACH = 0.4  # m, largest offset that is looked for; beyond it stands another thing
BEFORE, THROUGH, SPREAD = 0.2, 0.03, 0.05  # of the sightings of a surface: things before it, gaps in it, outliers
DEPTH = 5.0  # m over which what is met elsewhere than at a surface is spread
UNDECIDED = 0.16  # probability of the unlikelier of two verdicts, one standard deviation from the limit
SURE = float(np.log(100.0))  # log-likelihood of the evidence by which one hypothesis must lead


def bell(x: Floats, sigma: float = SENSOR.range_noise) -> Floats:
    """The density (1/m) of a Gaussian error of `x` metres."""
    return np.asarray(np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)))


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


def verdict_on_offset(distance: float, sigma: float, tolerance: float) -> tuple[Verdict, bool]:
    """The verdict on an offset (m) with its standard deviation, and whether it is sure.

    The likelier one; none where the measurement is coarser than the tolerance, unless one is by far likelier.
    """
    off = float(ndtr((distance - tolerance) / sigma) + ndtr((-distance - tolerance) / sigma))
    if sigma > tolerance and UNDECIDED < off < 1 - UNDECIDED:
        return "uncertain", False
    return ("as planned" if distance <= tolerance else "moved"), abs(distance - tolerance) > SURE_SIGMAS * sigma


def too_little(cells: int, views: int) -> str:
    """Why an element is not seen: the reason for the reader."""
    needed = f"{LEAST_CELLS} and {LEAST_VIEWS} are needed"
    return f"too little of it was seen: {cells} cells of {1000 * CELL:.0f} mm from {views} keyframes; {needed}"
