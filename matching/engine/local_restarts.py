"""Restarts rooms that explain few walls at positions nearby: a step of drift can exceed the basin of convergence."""

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.field import Fields, Scene, chi2, explained
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.field_step import step

ASIDE = 0.45  # metres, along both axes of the plan, both ways
SIGMAS = (0.25, 0.18, 0.13)
WELL_EXPLAINED = 0.75  # of a group's walls' weight that are explained
WALL = 2.0  # nats of a wall that is explained, for its weight,
MOST_STRAINED = 12.0  # against half the chi^2 to the neighbours, in the mean


def restart_locally(scene: Scene, fields: Fields, known: Index) -> Fields:
    """Returns the fields with each poorly explained group moved to where it explains most, given its neighbours."""
    poor = _explained(scene, known, fields.state) < WELL_EXPLAINED * (scene.s.weight @ scene.member)
    some = np.flatnonzero(poor.any(axis=1))
    if not len(some):
        return fields
    state = fields.state.copy()
    state[some] = _tried(scene, state[some], known[some], poor[some])
    return Fields(fields.storey, state)


def _tried(scene: Scene, state: Array, table: Index, poor: NDArray[np.bool_]) -> Array:
    """(K, G, 3) the best position nearby for each poorly explained group."""
    K, G = state.shape[:2]
    shifts = ASIDE * np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
    tried = np.repeat(state[:, None], len(shifts), axis=1)  # (K, shifts, G, 3)
    tried[..., 1:] += shifts[None, :, None] * poor[:, None, :, None]
    tried = tried.reshape(-1, G, 3)
    table = np.repeat(table, len(shifts), axis=0)
    for sigma in SIGMAS:
        tried = step(scene, table, tried, np.full((len(tried), G), sigma))
    merit = WALL * _explained(scene, table, tried) - 0.5 * _strained(scene, tried)
    best = np.where(poor, merit.reshape(K, len(shifts), G).argmax(axis=1), 0)
    return np.asarray(tried.reshape(K, len(shifts), G, 3)[np.arange(K)[:, None], best, np.arange(G)])


def _explained(scene: Scene, table: Index, state: Array) -> Array:
    """(K, G) weight of each group's walls that are explained."""
    return np.asarray((explained(scene, table, state, SIGMA_SCORE) * scene.s.weight) @ scene.member)


def _strained(scene: Scene, state: Array) -> Array:
    """(K, G) mean chi^2 of each group to its neighbours."""
    each = np.minimum(chi2(scene, state), MOST_STRAINED)
    total = np.concatenate((each, each), axis=1) @ scene.incidence
    return np.asarray(total / np.maximum(scene.incidence.sum(axis=0), 1.0))
