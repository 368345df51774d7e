"""Rooms that found no walls of theirs are tried a little aside: a step of drift can be wider than what draws them."""

import numpy as np

from matching.field import STEP, Fields, Scene, judge, partners, step, strain
from matching.scoring import SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index

ASIDE = 0.45  # metres, along both axes of the plan, both ways
SIGMAS = (0.25, 0.18, 0.13)
CONTENT = 0.75  # of a group's walls' weight that are explained
WALL = 2.0  # nats of a wall that is explained, for its weight,
MOST_STRAINED = 12.0  # against half the chi^2 to the neighbours, in the mean


def settled(scene: Scene, fields: Fields) -> Fields:
    """The fields with each discontented group where it is explained best, held by its neighbours."""
    K, G = fields.state.shape[:2]
    table = partners(scene, fields)
    weight = np.bincount(scene.groups.of_wall, scene.s.weight, G)
    discontented = _explained(scene, table, fields.state) < CONTENT * weight
    if not discontented.any():
        return fields
    shifts = ASIDE * np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
    tried = np.repeat(fields.state[:, None], len(shifts), axis=1)  # (K, shifts, G, 3)
    tried[..., 1:] += shifts[None, :, None] * discontented[:, None, :, None]
    tried = tried.reshape(-1, G, 3)
    tables = np.repeat(table, len(shifts), axis=0)
    for sigma in SIGMAS:
        tried = step(scene, tables, tried, np.full((len(tried), G), sigma))
    merit = WALL * _explained(scene, tables, tried) - 0.5 * _strained(scene, tried)
    best = np.where(discontented, merit.reshape(K, len(shifts), G).argmax(axis=1), 0)
    chosen = tried.reshape(K, len(shifts), G, 3)[np.arange(K)[:, None], best, np.arange(G)]
    return Fields(fields.storey, chosen)


def _explained(scene: Scene, table: Index, state: Array) -> Array:
    """(K, G) weight of each group's walls that are explained."""
    K, G = state.shape[:2]
    value = judge(scene, table, state, SIGMA_SCORE).quality.max(axis=2, initial=0.0) * scene.s.weight
    flat = np.arange(K)[:, None] * G + scene.groups.of_wall
    return np.asarray(np.bincount(flat.ravel(), value.ravel(), K * G).reshape(K, G))


def _strained(scene: Scene, state: Array) -> Array:
    """(K, G) chi^2 of each group to its neighbours, in the mean."""
    groups = scene.groups
    chi2 = ((strain(groups, state) / (STEP * groups.slack[:, None])) ** 2).sum(axis=-1)
    total, count = np.zeros(state.shape[:2]), np.zeros(state.shape[1])
    for end in groups.edges.T:
        np.add.at(total.T, end, np.minimum(chi2, MOST_STRAINED).T)
        np.add.at(count, end, 1.0)
    return total / np.maximum(count, 1.0)
