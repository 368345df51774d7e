"""What is known of the sensor's motion at one time, and how it goes on unobserved."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import levelling
from sgslam.inertial import Changes
from sgslam.registration.motion_prior import velocity_between
from sgslam.registration.window import MotionPrior, Prior, Solved

Floats = NDArray[np.float64]
_LEVEL_START = 0.25  # share of the vertical speeds that stairs need: a run begins on level ground


@dataclass(frozen=True, eq=False)
class Belief:
    """At `seconds`: the pose `T` (4, 4) in `odom`, the velocity (6,), and the covariances (6, 6) of both.

    Rotation first, in axes of `odom`. The velocity is the mean of the `lasted` seconds before; 0 where it is not known
    of which. While nothing is observed, `observed` is the last belief that was.
    """

    seconds: float
    T: Floats
    covariance: Floats
    velocity: Floats
    velocity_covariance: Floats
    lasted: float = 0.0
    observed: "Belief | None" = None

    @staticmethod
    def of(solved: Solved) -> "Belief":
        """What a window says of its last knot."""
        interval = float(solved.seconds[-1] - solved.seconds[-2])
        C = solved.covariance[-12:, -12:]
        ends, between = C[:6, :6] + C[6:, 6:], C[:6, 6:]
        return Belief(
            float(solved.seconds[-1]), solved.knots[-1], C[6:, 6:].copy(),  # as it is restored: bit by bit
            velocity_between(solved.knots[-2], solved.knots[-1], interval), (ends - between - between.T) / interval**2,
            interval,
        )  # fmt: skip

    def smoothed(self, solved: Solved, knot: int) -> "Belief":
        """The same belief with the mean that a later window gives this knot.

        Without it, windows that overlap by half would follow two courses in a direction that nothing measures.
        """
        velocity, lasted = self.velocity, self.lasted
        if knot:
            lasted = float(solved.seconds[knot] - solved.seconds[knot - 1])
            velocity = velocity_between(solved.knots[knot - 1], solved.knots[knot], lasted)
        return replace(
            self, seconds=float(solved.seconds[knot]), T=solved.knots[knot], velocity=velocity, lasted=lasted
        )


class MotionModel:
    """How the sensor moves on unobserved; once it is known where up is, less up and down than to the sides."""

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self.up = np.zeros(3)  # direction of gravity in `odom`; zero while it is unknown
        self.prior = MotionPrior(
            np.repeat([settings.turn_rate, settings.speed], 3),
            np.repeat([settings.turn_memory, settings.speed_memory], 3), np.eye(6),
        )  # fmt: skip

    def level(self, up_in_odom: Floats) -> None:
        """Takes the direction of gravity (3,) into account."""
        self.up = up_in_odom
        settings, axes = self._settings, np.eye(6)
        axes[3:, 3:] = levelling(up_in_odom)
        spread, memory = self.prior.spread.copy(), self.prior.memory.copy()
        spread[5], memory[5] = settings.vertical_speed, settings.sway_memory
        self.prior = MotionPrior(spread, memory, axes)

    def begin(self, seconds: float, T: Floats) -> Belief:
        """A known pose with an unknown velocity."""
        spread = self.prior.spread.copy()
        spread[5] *= _LEVEL_START if self.up.any() else 1.0
        return Belief(seconds, T, np.eye(6) * 1e-6, np.zeros(6), self._along(spread**2))

    def moving(self, seconds: float, T: Floats, sigma: float, velocity: Floats) -> Belief:
        """A pose known to `sigma` (rad and m), with a roughly known velocity."""
        return Belief(seconds, T, np.eye(6) * sigma**2, velocity, self._along((self.prior.spread / 5) ** 2))

    def unobserved(self, belief: Belief, seconds: float) -> Belief:
        """What remains of a belief at a later time: the pose stays, with a growing covariance. It grows from the last
        observed one on: who walks away unseen walks on, and does not choose a new way at each scan."""
        last = belief.observed or belief
        after, memory = seconds - last.seconds, self.prior.memory
        moved = self.prior.spread**2 * 2 * memory * (after - memory * (1 - np.exp(-after / memory)))
        covariance = last.covariance + self._along(moved) + np.diag((last.velocity * after) ** 2)
        return Belief(seconds, belief.T, covariance, np.zeros(6), self._along(self.prior.spread**2), 0.0, last)

    def expected(self, belief: Belief, seconds: Floats, height: float, changes: Changes) -> Prior:
        """The prior of a window whose knots have these times (K,); the belief is about the first one, the usual height
        (m) about all. Where it is among the measured `changes`, the velocity's change replaces what is usual."""
        kept = np.exp(-(seconds[1] - seconds[0]) / self.prior.memory)
        decay, grown = self._along(kept), self._along((1 - kept**2) * self.prior.spread**2)
        changed = np.zeros(6)
        if len(changes.information) and changes.information[0] > 0:
            changed[3:] = changes.values[0]
            decay[3:, 3:], grown[3:, 3:] = np.eye(3), np.eye(3) / changes.information[0]
        C = decay @ belief.velocity_covariance @ decay.T + grown
        known, steady = (np.linalg.inv(M).astype(np.float64) for M in (belief.covariance, C))
        known, steady = (known + known.T) / 2, (steady + steady.T) / 2
        variance = float(self.up @ belief.covariance[3:, 3:] @ self.up)
        return Prior(belief.T, known, decay @ belief.velocity + changed, steady, self.up, height, variance)

    def _along(self, values: Floats) -> Floats:
        """(6, 6) in axes of `odom`, with values (6,) along those of the prior."""
        axes = self.prior.axes
        return np.asarray(axes.T * values @ axes)
