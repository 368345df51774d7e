"""The times of a scan's points, from their order alone, where the file gives none."""

from dataclasses import dataclass
from math import tau
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rule = Literal["azimuth", "rings", "index"]

FEWEST = 200  # points
LEAST_TURN, MOST_TURN = 0.75 * tau, 1.12 * tau  # of a scan of about one turn; an open side has no returns
BACKWARDS = np.radians(25.0)  # the beams of one column differ in azimuth by up to some 20 degrees
LEAST_RINGS = 3
FORWARDS = 0.95  # share of all turning within rings
RING_SPREAD = 0.1  # variance of the elevation within rings, as a share of the whole variance
START_SPREAD = np.radians(30.0)  # azimuths at which rings begin
LINES = 8  # a sensor without turns fires up to so many lasers in turn
SMOOTH = 0.2  # step from a laser's point to its next, as a share of the distance of any two points
PARTS = 6  # of a scan by a sensor that does not repeat: each of them sees nearly the whole field of view
COVERED = 0.6  # share of the field of view
SECTORS, LAYERS = 8, 4  # into which the field of view is divided
SAMPLE = 1000  # points on which a scan's smoothness is measured


@dataclass(frozen=True)
class GuessedTimes:
    """Seconds (N,) since the scan began, from 0 up to its duration, and the rule that they follow.

    "azimuth": the points are in the order of a spinning sensor's columns; "rings": ring by ring, each of them once
    around; "index": in the order of time, by a sensor that does not turn once around.
    """

    seconds: Floats
    rule: Rule


def even_times(count: int, duration_s: float) -> Floats:
    """(count,) seconds in equal steps from 0 up to the duration."""
    return np.arange(count, dtype=np.float64) * (duration_s / max(count, 1))


def guessed_times(points: Floats, duration_s: float) -> GuessedTimes | None:
    """The times of points (N, 3), in the sensor's frame and stored order, of a scan that takes `duration_s`.

    Points may lack where nothing was returned. The spin axis is the sensor's z axis. Returns None where the order says
    nothing: shuffled, filtered or sorted points. Whether the sensor measured them one after the other at all (and not,
    as in some simulations, at one instant) is for registration to find out.
    """
    if len(points) < FEWEST:
        return None
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    steps = np.diff(azimuth)
    steps -= tau * np.rint(steps / tau)
    turned = np.concatenate([[0.0], np.cumsum(steps)])
    if turned[-1] < 0:
        turned, steps = -turned, -steps
    rule: Rule = "azimuth"
    progress = _by_azimuth(turned)
    if progress is None:
        elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
        rule, progress = "rings", _by_rings(turned, steps, elevation)
    if progress is None:
        is_by_index = _is_by_index(points, azimuth, elevation)
        return GuessedTimes(even_times(len(points), duration_s), "index") if is_by_index else None
    longest = max(tau, float(progress.max()))
    seconds = np.clip(progress, 0.0, None) * (duration_s / longest)
    return GuessedTimes(np.minimum(seconds, np.nextafter(duration_s, 0.0)), rule)


def _by_azimuth(turned: Floats) -> Floats | None:
    """(N,) radians since the first column, if the azimuth, unwrapped in `turned`, goes once around."""
    if not LEAST_TURN < turned.max() - turned.min() < MOST_TURN + BACKWARDS or turned[-1] < LEAST_TURN - BACKWARDS:
        return None
    if turned[-1] > MOST_TURN or (np.maximum.accumulate(turned) - turned).max() > BACKWARDS:
        return None
    return turned


def _by_rings(turned: Floats, steps: Floats, elevation: Floats) -> Floats | None:
    """(N,) radians since each ring's beginning, if the points go around often, each time at one elevation.

    All rings begin at one azimuth; where a ring has no return there, it begins later.
    """
    rings = round(turned[-1] / tau)
    if rings < LEAST_RINGS or np.maximum(steps, 0.0).sum() < FORWARDS * np.abs(steps).sum():
        return None
    first = _ring_beginnings(turned, elevation, rings)
    if first is None:
        return None
    counts = np.diff(np.append(first, len(turned)))
    of = np.repeat(np.arange(len(first)), counts)
    within = elevation - (np.add.reduceat(elevation, first) / counts)[of]
    if within.var() > RING_SPREAD * elevation.var():
        return None
    late = turned[first] - tau * np.rint((turned[first] - turned[0]) / tau)
    if np.ptp(late) > START_SPREAD:
        return None
    progress = turned - turned[first][of] + (late - late.min())[of]
    return progress if progress.max() < MOST_TURN + BACKWARDS else None


def _ring_beginnings(turned: Floats, elevation: Floats, rings: int) -> Ints | None:
    """(rings,) indices: near each full turn, where the elevation changes most; None if rings have hardly any points."""
    near = np.searchsorted(np.maximum.accumulate(turned), turned[0] + tau * (np.arange(rings + 1) - 0.1))
    after = np.searchsorted(np.maximum.accumulate(turned), turned[0] + tau * (np.arange(rings + 1) + 0.1))
    first = [0]
    for low, high in zip(near[1:rings], after[1:rings], strict=True):
        jumps = np.abs(np.diff(elevation[max(low - 1, 0) : high + 1]))
        if not len(jumps):
            return None
        first.append(max(low - 1, 0) + int(np.argmax(jumps)) + 1)
    return np.array(first) if np.all(np.diff(first) > 0) else None


def _is_by_index(points: Floats, azimuth: Floats, elevation: Floats) -> bool:
    """Whether the beam moves smoothly and soon covers the whole field of view.

    Sorted points are smooth too, but their parts lie at different places; shuffled points are not smooth.
    """
    rays = points / np.maximum(np.linalg.norm(points, axis=1), 1e-9)[:, None]
    some = np.arange(0, len(rays) - LINES, max(1, len(rays) // SAMPLE))
    any_two = _median_distance(rays[some], np.roll(rays[some], len(some) // 2 + 7, axis=0))
    if min(_median_distance(rays[some + k], rays[some]) for k in range(1, LINES + 1)) > SMOOTH * any_two:
        return False
    layer = np.searchsorted(np.quantile(elevation[some], np.arange(1, LAYERS) / LAYERS), elevation)
    sector = np.searchsorted(np.quantile(azimuth[some], np.arange(1, SECTORS) / SECTORS), azimuth)
    part = np.arange(len(points)) * PARTS // len(points)
    cells = PARTS * LAYERS * SECTORS
    seen = np.bincount((part * LAYERS + layer) * SECTORS + sector, minlength=cells).reshape(PARTS, -1)
    whole = seen.sum(axis=0)
    covered = ((seen > 0) * whole).sum(axis=1) / whole.sum()
    return bool(covered.min() >= COVERED)


def _median_distance(a: Floats, b: Floats) -> float:
    return float(np.median(np.linalg.norm(a - b, axis=1)))
