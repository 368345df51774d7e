"""One step of a field of motions: Gauss-Newton over all groups jointly.

The walls' offsets from lines and their directions, and between neighbours the difference of their motions at the
point between them. This is weighted down where it is large (Geman-McClure): drift runs along the robot's way, and
neighbours may have been met far apart on it.
"""

import numpy as np

from data.compiled import compiled
from matching import se2
from matching.field import STEP, Scene, judged, placed, strained
from matching.scoring import SIGMA_ALONG
from matching.se2 import Array
from matching.walls import Index

ROBUST = 3.0  # of the deviations of a step, from where on neighbours hold one another less
HELD = np.array([np.radians(10), 1.0, 1.0])  # one step of the estimate is at most about so large
SIGMA_TILT = float(np.radians(1.2))  # of a wall's direction in the map against the plan's
OFF_LINE = 0.03  # metres, of the ends of a wall: short ones tell less of a direction
SHARPEST = 0.1  # metres across, with which the directions count in full
SILENT = 1e3  # metres across: of walls that do not speak


def step(scene: Scene, table: Index, state: Array, sigma: Array) -> Array:
    """The state (K, G, 3) after a step, with the partners of a table (K, Ns, P). `sigma` (K, G) metres; infinite for
    a group whose walls do not speak yet."""
    groups = scene.groups
    own, right = np.zeros((*state.shape, 3)), np.zeros(state.shape)
    own[..., range(3), range(3)] = 1 / HELD**2
    between = np.empty((len(state), len(groups.edges), 3, 3))
    _pull_of_walls(*scene.s_arrays, scene.s.weight, scene.plan.lines, table, state, sigma, own, right)
    _pull_of_neighbours(groups.edges, groups.centre, groups.slack[:, None] * STEP, state, own, between, right)
    new = state + scene.band.solved(own, between, right)
    new[..., 0] = se2.wrap(new[..., 0])
    return np.asarray(new)


@compiled
def _pull_of_walls(
    heading: Array, half: Array, of_wall: Index, arm: Array, weight: Array, lines: Array, table: Index, state: Array,
    sigma: Array, own: Array, right: Array,
) -> None:  # fmt: skip
    """Adds information to `own` (K, G, 3, 3), its lower triangle, and the gradient to `right` (K, G, 3): of each wall
    against its best partner."""
    fields, walls, width = table.shape
    for k in range(fields):
        for i in range(walls):
            g = of_wall[i]
            wide = sigma[k, g]
            if wide >= SILENT:
                continue
            yaw, x, y, lever_x, lever_y = placed(state[k, g], arm[i])
            best, j, across, along, turned = 0.0, -1, 0.0, 0.0, 0.0
            for p in range(width):
                if table[k, i, p] >= 0:
                    line = lines[table[k, i, p]]
                    quality, _, off, run, turn = judged(line, half[i], heading[i] + yaw, x, y, wide)
                    if quality > best:
                        best, j, across, along, turned = quality, table[k, i, p], off, run, turn
            if j < 0:
                continue
            n_x, n_y = lines[j, 2], lines[j, 3]
            pull = best * weight[i] / wide**2
            slid = 0.25 / SIGMA_ALONG**2 * wide**2 * pull
            facing = pull * (SHARPEST**2 / (SIGMA_TILT**2 + (OFF_LINE / half[i]) ** 2))
            slip = slid * np.sign(along) * max(abs(along) - abs(lines[j, 0] - half[i]), 0.0)
            # How a residual along the normal, or the tangent, grows with the turn of the group.
            turn, turn_along = n_y * lever_x - n_x * lever_y, n_x * lever_x + n_y * lever_y
            own[k, g, 0, 0] += pull * turn**2 + slid * turn_along**2 + facing
            own[k, g, 1, 0] += pull * turn * n_x - slid * turn_along * n_y
            own[k, g, 2, 0] += pull * turn * n_y + slid * turn_along * n_x
            own[k, g, 1, 1] += pull * n_x**2 + slid * n_y**2
            own[k, g, 2, 1] += (pull - slid) * n_x * n_y
            own[k, g, 2, 2] += pull * n_y**2 + slid * n_x**2
            right[k, g, 0] -= pull * across * turn + slip * turn_along + facing * turned
            right[k, g, 1] -= pull * across * n_x - slip * n_y
            right[k, g, 2] -= pull * across * n_y + slip * n_x


@compiled
def _pull_of_neighbours(
    edges: Index, centre: Array, slack: Array, state: Array, own: Array, between: Array, right: Array
) -> None:
    """Adds to `own` and `right` as the walls do, and writes (K, E, 3, 3) the information of the two ends with each
    other; `slack` (E, 3) are the deviations.

    The residual's derivative by an end's motion is +-(1 0 0, -y 1 0, x 0 1) with the end's arm (x, y).
    """
    for k in range(len(state)):
        for e in range(len(edges)):
            g, h = edges[e, 0], edges[e, 1]
            (turn, off_x, off_y), arm_g, arm_h = strained(state[k, g], state[k, h], centre[g], centre[h])
            square = (turn / slack[e, 0]) ** 2 + (off_x / slack[e, 1]) ** 2 + (off_y / slack[e, 2]) ** 2
            less = 1 + square / ROBUST**2
            u, v, w = 1 / (slack[e, 0] * less) ** 2, 1 / (slack[e, 1] * less) ** 2, 1 / (slack[e, 2] * less) ** 2
            pull, push, press = u * turn, v * off_x, w * off_y
            (g_x, g_y), (h_x, h_y) = arm_g, arm_h
            for sign in (1.0, -1.0):
                end, x, y = (g, g_x, g_y) if sign > 0 else (h, h_x, h_y)
                own[k, end, 0, 0] += u + v * y**2 + w * x**2
                own[k, end, 1, 0] -= v * y
                own[k, end, 2, 0] += w * x
                own[k, end, 1, 1] += v
                own[k, end, 2, 2] += w
                right[k, end, 0] += sign * (pull - push * y + press * x)
                right[k, end, 1] += sign * push
                right[k, end, 2] += sign * press
            block = between[k, e]
            block[0, 0] = -(u + v * g_y * h_y + w * g_x * h_x)
            block[0, 1], block[0, 2] = v * g_y, -w * g_x
            block[1, 0], block[1, 1], block[1, 2] = v * h_y, -v, 0.0
            block[2, 0], block[2, 1], block[2, 2] = -w * h_x, 0.0, -w
