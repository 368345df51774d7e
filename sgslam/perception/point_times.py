"""The times of a scan's points, from their order alone, where the file gives none."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TURN = 2 * np.pi
LEAST_TURN, MOST_TURN = 0.75 * TURN, 1.12 * TURN  # of a scan of about one turn; an open side has no returns
BACKWARDS = np.radians(25.0)  # the beams of one column differ in azimuth by up to some 20 degrees
LEAST_RINGS = 3
FORWARDS = 0.95  # share of all turning within rings
RING_SPREAD = 0.1  # variance of the elevation within rings, as a share of the whole variance
START_SPREAD = np.radians(30.0)  # azimuths at which rings begin


def guessed_times(points: Floats, duration_s: float) -> Floats | None:
    """(N,) seconds since the scan began, from 0 up to the `duration_s` that it takes, of points (N, 3) in the sensor's
    frame and stored order; None where this is not the order of a spinning sensor.

    The sensor turns about its z axis, once around; the points are in the order of its columns, or ring by ring. Points
    may lack where nothing was returned. Whether the sensor measured them one after the other at all (and not, as in
    some simulations, at one instant) is for registration to find out.
    """
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    steps = np.diff(azimuth)
    steps -= TURN * np.rint(steps / TURN)
    turned = np.concatenate([[0.0], np.cumsum(steps)])
    if turned[-1] < 0:
        turned, steps = -turned, -steps
    progress = _by_azimuth(turned)
    if progress is None:
        elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
        progress = _by_rings(turned, steps, elevation)
    if progress is None:
        return None
    seconds = np.clip(progress, 0.0, None) * (duration_s / max(TURN, float(progress.max())))
    return np.minimum(seconds, np.nextafter(duration_s, 0.0))


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
    rings = round(turned[-1] / TURN)
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
    late = turned[first] - TURN * np.rint((turned[first] - turned[0]) / TURN)
    if np.ptp(late) > START_SPREAD:
        return None
    progress = turned - turned[first][of] + (late - late.min())[of]
    return progress if progress.max() < MOST_TURN + BACKWARDS else None


def _ring_beginnings(turned: Floats, elevation: Floats, rings: int) -> Ints | None:
    """(rings,) indices: near each full turn, where the elevation changes most; None if rings have hardly any points."""
    near = np.searchsorted(np.maximum.accumulate(turned), turned[0] + TURN * (np.arange(rings + 1) - 0.1))
    after = np.searchsorted(np.maximum.accumulate(turned), turned[0] + TURN * (np.arange(rings + 1) + 0.1))
    first = [0]
    for low, high in zip(near[1:rings], after[1:rings], strict=True):
        jumps = np.abs(np.diff(elevation[max(low - 1, 0) : high + 1]))
        if not len(jumps):
            return None
        first.append(max(low - 1, 0) + int(np.argmax(jumps)) + 1)
    return np.array(first) if np.all(np.diff(first) > 0) else None
