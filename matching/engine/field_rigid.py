"""The rigid motions nearest to fields of motions, and which of these differ."""

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index
from matching.engine.field import Fields, Scene
from matching.engine.field_loops import Loops, turns, wall_poses

DISTINCT_M, DISTINCT_RAD = 0.5, float(np.radians(5))
LEAST_WEIGHT = 1e-6  # of a wall that is not explained


def rigid(scene: Scene, fields: Fields, quality: Array) -> Array:
    """(K, 3) the rigid motions nearest to fields, from the ends of the walls they explain with quality (K, Ns)."""
    return np.asarray(_rigid(scene.loops, scene.s.centre, fields.state, quality))


@compiled
def _rigid(m: Loops, centre: Array, state: Array, quality: Array) -> Array:
    found, heading, half = np.empty((len(state), 3)), m.heading, m.half
    for k in range(len(state)):
        pose, weight = wall_poses(m, state[k], turns(state[k])), m.weight * quality[k] + LEAST_WEIGHT
        weight /= weight.sum()
        p_x, p_y = (weight * centre[:, 0]).sum(), (weight * centre[:, 1]).sum()
        q_x, q_y = (weight * pose[:, 1]).sum(), (weight * pose[:, 2]).sum()
        cross, dot = 0.0, 0.0
        for i in range(len(weight)):
            t_x, t_y = -half[i] * np.sin(heading[i]), half[i] * np.cos(heading[i])
            u_x, u_y = -half[i] * np.sin(pose[i, 0]), half[i] * np.cos(pose[i, 0])
            x, y, u, v = centre[i, 0] - p_x, centre[i, 1] - p_y, pose[i, 1] - q_x, pose[i, 2] - q_y
            cross += weight[i] * (x * v - y * u + t_x * u_y - t_y * u_x)  # the mean of both ends
            dot += weight[i] * (x * u + y * v + t_x * u_x + t_y * u_y)
        yaw = np.arctan2(cross, dot)
        cos, sin = np.cos(yaw), np.sin(yaw)
        found[k, 0], found[k, 1] = yaw, q_x - (cos * p_x - sin * p_y)
        found[k, 2] = q_y - (sin * p_x + cos * p_y)
    return found


@compiled
def distinct(storey: Index, rigid: Array) -> Index:
    """Indices of those that differ from all earlier ones: in storey, at S's centroid (the origin) or in yaw."""
    kept, count = np.empty(len(rigid), dtype=np.int64), 0
    for n in range(len(rigid)):
        new = True
        for m in kept[:count]:
            off = np.hypot(rigid[m, 1] - rigid[n, 1], rigid[m, 2] - rigid[n, 2])
            near = off <= DISTINCT_M and abs(wrapped(rigid[m, 0] - rigid[n, 0])) <= DISTINCT_RAD
            new = new and not (near and storey[m] == storey[n])
        if new:
            kept[count] = n
            count += 1
    return kept[:count].copy()
