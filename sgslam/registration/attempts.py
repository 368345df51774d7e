"""From which prediction a scan is registered: the expected one, and where the result does not fit, others."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.config import TrackingSettings
from sgslam.registration.window import Solved

Floats = NDArray[np.float64]


def _turns(degrees: tuple[float, ...]) -> Floats:
    """(3 N, 4, 4) rotations by these angles about each axis of the sensor, since its mount is not known."""
    turns = np.tile(np.eye(4), (3 * len(degrees), 1, 1))
    vectors = [np.radians(angle) * axis for axis in np.eye(3) for angle in degrees]
    turns[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    return turns


_LOST_TURNS = _turns((-60.0, -30.0, 30.0, 60.0, 90.0))  # while the sensor was lost
_SWINGS = _turns((-36.0, -18.0, 18.0, 36.0))  # from the prediction: a hand turns back by as much within a scan
_FEW = 4  # iterations that show which of many predictions lead to the map
_FINISHED = 2  # of these predictions, so many


def best_attempt(
    attempt: Callable[[list[Floats], float, int], Solved], fits: Callable[[Solved], bool], ahead: list[Floats],
    stopped: list[Floats] | None, given: list[Floats] | None, was_lost: bool, turn_known: bool,
    settings: TrackingSettings,
) -> Solved:  # fmt: skip
    """The best result of `attempt`, which registers a scan from predicted poses (4, 4) of its knots, with a kernel (m)
    and a largest number of iterations.

    Those `ahead` are expected. If the result does not fit, they are tried with a wide kernel, as is a sensor that
    `stopped`, unless it is known by an accelerometer that it did not, or moved as another system has `given`, or turned
    there while it was lost; then one that swung to another attitude than ahead. Where the turn is known, by a
    gyroscope, no other one is tried.
    """

    def closest(best: Solved, guesses: list[list[Floats]]) -> Solved:
        if len(guesses) > _FINISHED:
            close = np.array([attempt(guess, settings.wide_kernel, _FEW).close for guess in guesses])
            chosen = np.argsort(close, kind="stable")[-_FINISHED:]
            guesses = [guesses[i] for i in sorted(chosen) if close[i] > best.close]
        finished = [attempt(guess, settings.wide_kernel, settings.iterations) for guess in guesses]
        return max([best, *finished], key=lambda solved: solved.close)

    best = attempt(ahead, settings.first_kernel, settings.iterations)
    if fits(best):
        return best
    turned = [] if stopped is None or turn_known or not was_lost else _turned(stopped, _LOST_TURNS)
    best = closest(best, [ahead, *(own for own in (stopped, given) if own is not None), *turned])
    if fits(best) or was_lost or turn_known:
        return best
    swung = closest(best, _turned(ahead, _SWINGS))
    return swung if fits(swung) else best  # some fit a little by chance


def _turned(poses: list[Floats], turns: Floats) -> list[list[Floats]]:
    """The same poses (4, 4) turned about the sensor's place by each of `turns` (N, 4, 4)."""
    return [[pose @ turn for pose in poses] for turn in turns]
