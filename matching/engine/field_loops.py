"""Compiled loops of a field of motions: wall by wall functions, and a Gauss-Newton step over all groups jointly.

Residuals of the step are the walls' offsets from lines and their directions, and the difference of neighbours' motions
at the point between them. The latter is weighted down where it is large (Geman-McClure): drift accumulates along the
robot's path, and two neighbours may be far apart on it.
"""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.arrays.blocks import Elimination, solve

SAME_DIRECTION = float(np.radians(15))
SIGMA_SCORE = 0.15  # metres across, of the final judgement
SIGMA_HEADING = float(np.radians(5))
SIGMA_ALONG = 0.4  # metres; the ends of walls are seen badly
FAR = 9.0  # deviations: what is further off is as good as none
ROBUST = 3.0  # deviations of a step beyond which neighbours are weighted down
HELD = np.array([np.radians(10), 1.0, 1.0])  # damping: limits the size of a step
SIGMA_TILT = float(np.radians(1.2))  # of a wall's direction in the map against the plan's
OFF_LINE = 0.03  # metres, of a wall's ends: short walls give less direction
SHARPEST = 0.1  # metres across, with which the directions count in full
SILENT = 1e3  # metres across: of walls that are not used


@compiled
def wrapped(angle: float) -> float:
    """An angle to [-pi, pi)."""
    return float(angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi)))


class Loops(NamedTuple):
    """The arrays of a scene that compiled loops need."""

    heading: Array  # (Ns,)
    half: Array
    weight: Array
    group: Index
    arm: Array  # (Ns, 2)
    centre: Array  # (G, 2)
    edges: Index  # (E, 2)
    slack: Array  # (E, 3) deviations
    elimination: Elimination  # of the groups, joined by the edges
    lines: Array  # (Na, 6) as those of `Walls`
    order: Index  # (Na,) as `PlanWalls.by_heading`
    ordered: Array
    ordered_lines: Array  # (6, Na)
    first: Index  # (storeys + 1,)


@compiled
def of_direction(ordered: Array, begin: int, end: int, heading: float, width: float) -> tuple[int, int, int, int]:
    """Where headings within a width of a heading in [-pi, pi) begin and end among ascending ones, between two places.

    A second range holds those that wrap around a full turn.
    """
    low, high, some = heading - width, heading + width, ordered[begin:end]
    first = begin + int(np.searchsorted(some, low))
    last = begin + int(np.searchsorted(some, high, side="right"))
    if low < -np.pi:
        return first, last, begin + int(np.searchsorted(some, low + 2 * np.pi)), end
    if high >= np.pi:
        return first, last, begin, begin + int(np.searchsorted(some, high - 2 * np.pi, side="right"))
    return first, last, end, end


@compiled
def off_lines(lines: Array, first: int, last: int, x: float, y: float, off: Array) -> None:
    """Writes the distances of a point from lines (6, Na), across and along; compiles to vector code."""
    n_x, n_y, at = lines[2, first:last], lines[3, first:last], lines[4, first:last]
    for n in range(len(at)):
        off[n] = abs(n_x[n] * x + n_y[n] * y - at[n])


@compiled
def turns(state: Array) -> Array:
    """(G, 2) cosines and sines of a field's (G, 3) yaws."""
    found = np.empty((len(state), 2))
    for g in range(len(state)):
        found[g, 0], found[g, 1] = np.cos(state[g, 0]), np.sin(state[g, 0])
    return found


@compiled
def wall_poses(m: Loops, state: Array, turn: Array) -> Array:
    """(Ns, 5) the walls under a field (G, 3) with known `turns`: heading, mid point, and mid point from the group's
    centre.
    """
    heading, group, arm, pose = m.heading, m.group, m.arm, np.empty((len(m.heading), 5))
    for i in range(len(pose)):
        g = group[i]
        cos, sin = turn[g, 0], turn[g, 1]
        pose[i, 3] = cos * arm[i, 0] - sin * arm[i, 1]
        pose[i, 4] = sin * arm[i, 0] + cos * arm[i, 1]
        pose[i, 0], pose[i, 1] = heading[i] + state[g, 0], state[g, 1] + pose[i, 3]
        pose[i, 2] = state[g, 2] + pose[i, 4]
    return pose


@compiled
def compared(lines: Array, j: int, half: float, pose: Array, i: int) -> tuple[float, float, float, float]:
    """The offset of a placed wall of the map from a wall of the plan across, along and in direction, and its
    overlap.
    """
    across = lines[j, 2] * pose[i, 1] + lines[j, 3] * pose[i, 2] - lines[j, 4]
    along = lines[j, 2] * pose[i, 2] - lines[j, 3] * pose[i, 1] - lines[j, 5]
    return across, along, wrapped(pose[i, 0] - lines[j, 1]), _share_beside(along, half, lines[j, 0])


@compiled
def _share_beside(along: float, half: float, a_half: float) -> float:
    span = 1.6 * min(half, 4.0)  # a fifth of a wall may stand out: its ends slide
    common = min(half + a_half - abs(along), 2 * min(half, a_half))
    return min(common / span, 1.0) if common > 0 else 0.0


@compiled
def sharpness(sigma: float) -> tuple[float, float]:
    """The weights of squared metres across and squared radians for a deviation across."""
    sigma_turned = SIGMA_HEADING * min(max(sigma / SIGMA_SCORE, 1.0), 2.0)
    return 0.5 / sigma**2, 0.5 / sigma_turned**2


@compiled
def best_pair(
    lines: Array, half: float, pose: Array, table: Index, i: int, sharp: tuple[float, float]
) -> tuple[float, int]:
    """The quality of a wall's best pair among its partners, and that wall of the plan, -1 for none."""
    best, at, heading, x, y = 0.0, -1, pose[i, 0], pose[i, 1], pose[i, 2]
    for p in range(table.shape[1]):
        j = table[i, p]
        if j < 0:
            break
        # A pair that cannot be better is left as soon as that shows: exp(-x) is at most 1 / (1 + x).
        line = lines[j]
        strange = sharp[0] * (line[2] * x + line[3] * y - line[4]) ** 2
        if best * (1 + strange) >= 1:
            continue
        beside = _share_beside(line[2] * y - line[3] * x - line[5], half, line[0])
        if beside == 0:
            continue
        strange += sharp[1] * wrapped(heading - line[1]) ** 2
        if beside > best * (1 + strange):
            quality = beside * np.exp(-strange)
            if quality > best:
                best, at = quality, j
    return best, at


@compiled
def strained(
    m: Loops, e: int, state: Array, turn: Array
) -> tuple[float, tuple[float, float, float], tuple[float, float], tuple[float, float]]:
    """How differently a field (G, 3) with known `turns` moves the neighbours of an edge, at the point between them.

    Returns the squares in deviations, the differences (radians, metres, metres), and that point from either centre.
    """
    g, h, centre, slack = m.edges[e, 0], m.edges[e, 1], m.centre, m.slack
    half_x, half_y = (centre[h, 0] - centre[g, 0]) / 2, (centre[h, 1] - centre[g, 1]) / 2
    cos, sin = turn[g, 0], turn[g, 1]
    x, y = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    cos, sin = -turn[h, 0], -turn[h, 1]
    u, v = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    turned = wrapped(state[h, 0] - state[g, 0])
    off_x, off_y = state[h, 1] - state[g, 1] + u - x, state[h, 2] - state[g, 2] + v - y
    square = (turned / slack[e, 0]) ** 2 + (off_x / slack[e, 1]) ** 2 + (off_y / slack[e, 2]) ** 2
    return square, (turned, off_x, off_y), (x, y), (u, v)


def step(m: Loops, table: Index, state: Array, sigma: Array) -> Array:
    """Returns the state (K, G, 3) after a step, given a table of partners (K, Ns, P) and `sigma` (K, G) in metres;
    infinite for groups whose walls are not used yet.
    """
    new = state.copy()
    _all_stepped(m, table, new, sigma)
    return new


@compiled
def _all_stepped(m: Loops, table: Index, state: Array, sigma: Array) -> None:
    for k in range(len(state)):
        stepped(m, table[k], state[k], sigma[k])


@compiled
def stepped(m: Loops, table: Index, state: Array, sigma: Array) -> None:
    """Moves one field (G, 3) by a step, in place."""
    own, between = np.zeros((len(state), 3, 3)), np.zeros((len(m.elimination.later), 3, 3))
    right = np.zeros(state.shape)
    for d in range(3):
        own[:, d, d] = 1 / HELD[d] ** 2
    turn = turns(state)
    _pull_of_walls(m, table, state, turn, sigma, own, right)
    _pull_of_neighbours(m, state, turn, own, between, right)
    solve(m.elimination, own, between, right)
    for g in range(len(state)):
        for d in range(3):
            state[g, d] += right[g, d]
        state[g, 0] = wrapped(state[g, 0])


@compiled
def _pull_of_walls(m: Loops, table: Index, state: Array, turn: Array, sigma: Array, own: Array, right: Array) -> None:
    """Adds the information of each wall and its best partner to `own` (G, 3, 3), lower triangles, and its gradient
    to `right` (G, 3).
    """
    lines, half, group, pose = m.lines, m.half, m.group, wall_poses(m, state, turn)
    for i in range(len(table)):
        g, wide = group[i], sigma[group[i]]
        if wide >= SILENT:
            continue
        best, j = best_pair(lines, half[i], pose, table, i, sharpness(wide))
        if j < 0:
            continue
        across, along, turned, _ = compared(lines, j, half[i], pose, i)
        n_x, n_y, lever_x, lever_y = lines[j, 2], lines[j, 3], pose[i, 3], pose[i, 4]
        pull = best * m.weight[i] / wide**2
        slid = 0.25 / SIGMA_ALONG**2 * wide**2 * pull
        facing = pull * (SHARPEST**2 / (SIGMA_TILT**2 + (OFF_LINE / half[i]) ** 2))
        slip = slid * np.sign(along) * max(abs(along) - abs(lines[j, 0] - half[i]), 0.0)
        # How a residual along the normal, or the tangent, grows with the turn of the group.
        lever, lever_along = n_y * lever_x - n_x * lever_y, n_x * lever_x + n_y * lever_y
        own[g, 0, 0] += pull * lever**2 + slid * lever_along**2 + facing
        own[g, 1, 0] += pull * lever * n_x - slid * lever_along * n_y
        own[g, 2, 0] += pull * lever * n_y + slid * lever_along * n_x
        own[g, 1, 1] += pull * n_x**2 + slid * n_y**2
        own[g, 2, 1] += (pull - slid) * n_x * n_y
        own[g, 2, 2] += pull * n_y**2 + slid * n_x**2
        right[g, 0] -= pull * across * lever + slip * lever_along + facing * turned
        right[g, 1] -= pull * across * n_x - slip * n_y
        right[g, 2] -= pull * across * n_y + slip * n_x


@compiled
def _pull_of_neighbours(m: Loops, state: Array, turn: Array, own: Array, between: Array, right: Array) -> None:
    """Adds the information of neighbours, and writes that of the two ends of each edge with each other.

    The Jacobian of the residual with respect to an end's motion is +-(1 0 0, -y 1 0, x 0 1) with the end's arm (x, y).
    """
    for e in range(len(m.edges)):
        square, (turned, off_x, off_y), arm_g, arm_h = strained(m, e, state, turn)
        less = 1 + square / ROBUST**2
        u, v, w = 1 / (m.slack[e, 0] * less) ** 2, 1 / (m.slack[e, 1] * less) ** 2, 1 / (m.slack[e, 2] * less) ** 2
        pull, push, press = u * turned, v * off_x, w * off_y
        for sign, g, (x, y) in ((1.0, m.edges[e, 0], arm_g), (-1.0, m.edges[e, 1], arm_h)):
            own[g, 0, 0] += u + v * y**2 + w * x**2
            own[g, 1, 0] -= v * y
            own[g, 2, 0] += w * x
            own[g, 1, 1] += v
            own[g, 2, 2] += w
            right[g, 0] += sign * (pull - push * y + press * x)
            right[g, 1] += sign * push
            right[g, 2] += sign * press
        (x, y), (p, q) = (arm_h, arm_g) if m.elimination.turned[e] else (arm_g, arm_h)  # of the row, of the column
        n = m.elimination.of_edge[e]
        between[n, 0, 0], between[n, 0, 1], between[n, 0, 2] = -(u + v * y * q + w * x * p), v * y, -w * x
        between[n, 1, 0], between[n, 1, 1] = v * q, -v
        between[n, 2, 0], between[n, 2, 2] = -w * p, -w
