"""One step of a field of motions: Gauss-Newton over all groups jointly.

The walls' offsets from lines and their directions, and between neighbours the difference of their motions at the
point between them. This is weighted down where it is large (Geman-McClure): drift runs along the robot's way, and
neighbours may have been met far apart on it.
"""

import numpy as np

from matching import se2
from matching.field import STEP, Pairs, Placed, Scene, judged, placed, strain_and_arms
from matching.scoring import SIGMA_ALONG
from matching.se2 import Array

ROBUST = 3.0  # of the deviations of a step, from where on neighbours hold one another less
HELD = np.array([np.radians(10), 1.0, 1.0])  # one step of the estimate is at most about so large
SIGMA_TILT = np.radians(1.2)  # of a wall's direction in the map against the plan's
OFF_LINE = 0.03  # metres, of the ends of a wall: short ones tell less of a direction
SHARPEST = 0.1  # metres across, with which the directions count in full
SILENT = 1e3  # metres across: of walls that do not speak
SYMMETRIC, DIAGONAL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]]), np.array([0, 3, 5])  # of upper triangles


def step(scene: Scene, pairs: Pairs, state: Array, sigma: Array) -> Array:
    """The state (K, G, 3) after a step. `sigma` (K, G) metres; infinite for a group whose walls do not speak yet."""
    own, between = _of_neighbours(scene, state)
    rows = _of_walls(scene, pairs, placed(scene, state), sigma) @ scene.member + own
    rows[DIAGONAL] += 1 / HELD[:, None, None] ** 2
    information = np.moveaxis(rows[SYMMETRIC], (0, 1), (2, 3))
    new = state + scene.band.solved(information, between, np.moveaxis(rows[6:], 0, 2))
    new[..., 0] = se2.wrap(new[..., 0])
    return np.asarray(new)


def _of_walls(scene: Scene, pairs: Pairs, at: Placed, sigma: Array) -> Array:
    """(9, K, Ns) information (its upper triangle) and gradient, each wall against its best partner."""
    s, plan = scene.s, scene.plan
    per_wall = np.minimum(sigma, SILENT)[:, scene.groups.of_wall]
    now = judged(scene, pairs, at, per_wall[..., None])
    best = now.quality.argmax(axis=2).ravel() + np.arange(per_wall.size) * now.quality.shape[2]
    quality, across, along, turned, n_x, n_y, j = (
        np.take(x, best).reshape(per_wall.shape)
        for x in (now.quality, now.across, now.along, now.turned, pairs.normal_x, pairs.normal_y, pairs.table)
    )
    weight = np.where(per_wall < SILENT, quality * s.weight, 0.0) / per_wall**2
    slid = 0.25 / SIGMA_ALONG**2 * per_wall**2 * weight
    facing = weight * (SHARPEST**2 / (SIGMA_TILT**2 + (OFF_LINE / s.half) ** 2))
    excess = np.sign(along) * np.maximum(np.abs(along) - np.abs(plan.half[j] - s.half), 0.0)
    # How a residual along the normal, or the tangent, grows with the turn of the group.
    turn, turn_along = n_y * at.lever_x - n_x * at.lever_y, n_x * at.lever_x + n_y * at.lever_y
    off, slip = weight * across, slid * excess
    return np.stack((
        weight * turn**2 + slid * turn_along**2 + facing,
        weight * turn * n_x - slid * turn_along * n_y, weight * turn * n_y + slid * turn_along * n_x,
        weight * n_x**2 + slid * n_y**2, (weight - slid) * n_x * n_y, weight * n_y**2 + slid * n_x**2,
        -off * turn - slip * turn_along - facing * turned, slip * n_y - off * n_x, -off * n_y - slip * n_x,
    ))  # fmt: skip


def _of_neighbours(scene: Scene, state: Array) -> tuple[Array, Array]:
    """(9, K, G) as of the walls, summed up; and (K, E, 3, 3) information of the two ends with each other.

    The residual's derivative by an end's motion is +-(1 0 0, -y 1 0, x 0 1) with the end's arm (x, y).
    """
    residual, ((g_x, g_y), (h_x, h_y)) = strain_and_arms(scene.groups, state)
    sigma = (STEP * scene.groups.slack[:, None]).T[:, None]  # (3, 1, E)
    weight = 1 / (sigma * (1 + ((residual / sigma) ** 2).sum(axis=0) / ROBUST**2)) ** 2  # (3, K, E)
    u, v, w = weight
    pull, push, press = weight * residual
    zero = np.zeros_like(u)
    ends = [
        (u + v * y**2 + w * x**2, -v * y, w * x, v, zero, w, sign * (pull - push * y + press * x), sign * push,
         sign * press) for sign, x, y in ((1.0, g_x, g_y), (-1.0, h_x, h_y))
    ]  # fmt: skip
    between = np.stack((
        u + v * g_y * h_y + w * g_x * h_x, -v * g_y, w * g_x, -v * h_y, v, zero, w * h_x, zero, w,
    ), axis=-1)  # fmt: skip
    return np.concatenate(np.array(ends), axis=-1) @ scene.incidence, -between.reshape(*u.shape, 3, 3)
