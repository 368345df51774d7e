"""Prior of the motion between knots: white noise on acceleration (Anderson and Barfoot, IROS 2015).

Knots are poses (4, 4) of the sensor in `odom` at given times; between two of them it moves and turns steadily. A
velocity is (6,): the rotation vector and the translation, in axes of `odom`, a second.
"""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.compiled import rotated_by, turn_between
from sgslam.inertial import Changes, Steps

Floats = NDArray[np.float64]
_OUTLIER = 3.0  # standard deviations, from which on a step counts little


@compiled
def velocity_between(T_a: Floats, T_b: Floats, seconds: float) -> Floats:
    """(6,) the steady velocity from one pose to another."""
    v, turn = np.empty(6), turn_between(T_a, T_b)
    for i in range(3):
        v[i] = turn[i] / seconds
        v[3 + i] = (T_b[i, 3] - T_a[i, 3]) / seconds
    return v


@compiled
def moved_on(T: Floats, velocity: Floats, seconds: float) -> Floats:
    """(4, 4) the pose after so many seconds with a steady velocity (6,)."""
    result = T.copy()
    turn = velocity[0] * seconds, velocity[1] * seconds, velocity[2] * seconds
    for j in range(3):
        result[0, j], result[1, j], result[2, j] = rotated_by(*turn, T[0, j], T[1, j], T[2, j])
    for i in range(3):  # an operation on slices takes seconds to compile
        result[i, 3] += velocity[3 + i] * seconds
    return result


@compiled
def add_pose(T: Floats, expected: Floats, information: Floats, H: Floats, g: Floats) -> None:
    """Adds a measurement of the first knot: its `expected` pose (4, 4) and the information (6, 6)."""
    off = velocity_between(expected, T, 1.0)
    for i in range(6):
        for j in range(6):
            H[i, j] += information[i, j]
            g[i] += information[i, j] * off[j]


@compiled
def add_height(
    knots: Floats, up: Floats, height: float, variance: float, sway: float, share: float, H: Floats, g: Floats
) -> None:
    """Adds to normal equations H (6K, 6K), g (6K,) that a carried sensor keeps its `height` (m) along `up` (3,), as
    long as the ground is level, within a standard deviation of `sway` (m).

    The window is the given `share` of the time in which that is measured once. Farther off, the weight falls as that of
    an outlier (Geman-McClure), unless the height is not known better, by its `variance` (m2): who climbs a stair is not
    held back.
    """
    for k in range(len(knots)):
        off = up[0] * knots[k, 0, 3] + up[1] * knots[k, 1, 3] + up[2] * knots[k, 2, 3] - height
        robust = 1 / (1 + off * off / (4 * (sway * sway + variance)))
        weight = share * robust * robust / (sway * sway * len(knots))
        for i in range(3):
            g[6 * k + 3 + i] += weight * off * up[i]
            for j in range(3):
                H[6 * k + 3 + i, 6 * k + 3 + j] += weight * up[i] * up[j]


@compiled
def _add_between(a: int, off: float, weight: float, H: Floats, g: Floats) -> None:
    """Adds a measured difference of unknown `a` from the same one of the next knot, which is `off` by so much."""
    b = a + 6
    g[a] -= weight * off
    g[b] += weight * off
    H[a, a] += weight
    H[b, b] += weight
    H[a, b] -= weight
    H[b, a] -= weight


@compiled
def add_steps(knots: Floats, steps: Steps, H: Floats, g: Floats) -> None:
    """Adds a gyroscope's turns or another system's steps between knots to normal equations H (6K, 6K), g (6K,).

    Farther off, a system's step weighs less, as an outlier (Geman-McClure): it may slip or lose its way. How a step, a
    few centimetres long, turns with its first knot is left out.
    """
    expected = np.empty((4, 4))
    for k in range(len(steps.information)):
        turn_weight, way_weight = steps.information[k]
        if turn_weight <= 0.0:
            continue
        for i in range(4):
            for j in range(4):
                expected[i, j] = 0.0
                for c in range(4):
                    expected[i, j] += knots[k, i, c] * steps.poses[k, c, j]
        off = velocity_between(expected, knots[k + 1], 1.0)
        size = turn_weight * (off[0] ** 2 + off[1] ** 2 + off[2] ** 2)
        size += way_weight * (off[3] ** 2 + off[4] ** 2 + off[5] ** 2)
        robust = (1 / (1 + size / _OUTLIER**2)) ** 2 if way_weight > 0.0 else 1.0
        for i in range(6):
            weight = robust * (turn_weight if i < 3 else way_weight)
            _add_between(6 * k + i, off[i], weight, H, g)


@compiled
def add_changes(times: Floats, knots: Floats, changes: Changes, H: Floats, g: Floats) -> None:
    """Adds an accelerometer's changes of velocity at all but the last knot to normal equations H (6K, 6K), g (6K,).

    That at the first one, of the velocity before the window, is left out.
    """
    axis = np.zeros(6)
    for k in range(1, len(changes.information)):
        rate, earlier = 1 / (times[k + 1] - times[k]), 1 / (times[k] - times[k - 1])
        for c in range(3):
            axis[:] = 0.0
            axis[3 + c] = 1.0
            later, before = knots[k + 1, c, 3] - knots[k, c, 3], knots[k, c, 3] - knots[k - 1, c, 3]
            off = rate * later - earlier * before - changes.values[k, c]
            _add_change(k, axis, earlier, rate, off, changes.information[k], H, g)


@compiled
def _add_change(
    k: int, axis: Floats, earlier: float, rate: float, off: float, weight: float, H: Floats, g: Floats
) -> None:
    """Adds a measured change of the velocity at knot `k` along an axis (6,), which is `off` by so much; the rates are
    1/s, of the pieces before and after it."""
    J = (earlier, -earlier - rate, rate)
    for a in range(3):
        for c in range(6):
            if axis[c] != 0.0:
                row, one = 6 * (k - 1 + a) + c, weight * J[a] * axis[c]
                g[row] += one * off
                for b in range(3):
                    for d in range(6):
                        H[row, 6 * (k - 1 + b) + d] += one * J[b] * axis[d]


@compiled
def add_velocities(
    times: Floats, knots: Floats, expected: Floats, information: Floats, spread: Floats, memory: Floats,
    axes: Floats, H: Floats, g: Floats,
) -> None:  # fmt: skip
    """Adds the prior of all velocities to normal equations H (6K, 6K), g (6K,).

    The first has an `expected` value (6,) with information (6, 6); each other one follows the one before as an
    Ornstein-Uhlenbeck process of standard deviation `spread` (6,), rad/s and m/s, with a `memory` (6,) of so many
    seconds: for short times white noise on acceleration, but a speed that nothing measures does not grow. Both are
    along the rows of `axes` (6, 6): a sensor rises and sinks less than it walks on.
    """
    before, earlier = expected, 0.0
    for k in range(len(knots) - 1):
        rate = 1 / (times[k + 1] - times[k])
        velocity = velocity_between(knots[k], knots[k + 1], 1 / rate)
        for i in range(6):
            if k == 0:
                for j in range(6):
                    weight = information[i, j] * rate
                    g[i] -= weight * (velocity[j] - expected[j])
                    g[6 + i] += weight * (velocity[j] - expected[j])
                    H[i, j] += weight * rate
                    H[6 + i, 6 + j] += weight * rate
                    H[i, 6 + j] -= weight * rate
                    H[6 + i, j] -= weight * rate
                continue
            kept = math.exp(-(times[k + 1] - times[k - 1]) / 2 / memory[i])
            off, weight = 0.0, 1 / (spread[i] ** 2 * (1 - kept * kept))
            for c in range(6):
                off += axes[i, c] * (velocity[c] - kept * before[c])
            _add_change(k, axes[i], kept * earlier, rate, off, weight, H, g)
        before, earlier = velocity, rate
