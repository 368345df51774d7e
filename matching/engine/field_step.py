"""One Gauss-Newton step of a field of motions, over all groups jointly.

Residuals are the walls' offsets from lines and their directions, and the difference of neighbours' motions at the point
between them. The latter is weighted down where it is large (Geman-McClure): drift accumulates along the robot's path,
and two neighbours may be far apart on it.
"""

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index
from matching.arrays.blocks import solve
from matching.engine.field import Scene
from matching.engine.field_loops import SIGMA_ALONG, Loops, best_pair, compared, sharpness, strained, turns, wall_poses

ROBUST = 3.0  # deviations of a step beyond which neighbours are weighted down
HELD = np.array([np.radians(10), 1.0, 1.0])  # damping: limits the size of a step
SIGMA_TILT = float(np.radians(1.2))  # of a wall's direction in the map against the plan's
OFF_LINE = 0.03  # metres, of a wall's ends: short walls give less direction
SHARPEST = 0.1  # metres across, with which the directions count in full
SILENT = 1e3  # metres across: of walls that are not used


def step(scene: Scene, table: Index, state: Array, sigma: Array) -> Array:
    """Returns the state (K, G, 3) after a step, given a table of partners (K, Ns, P) and `sigma` (K, G) in metres;
    infinite for groups whose walls are not used yet.
    """
    new = state.copy()
    _all_stepped(scene.loops, table, new, sigma)
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
