"""Proposals without learning: corners of parts of the map vote for placements, and each gives its walls a score."""

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index
from matching.arrays.groups import Groups
from matching.engine.corners import corners
from matching.engine.field import Fields, Scene, judge, rigid_state
from matching.engine.guided_field import advance, guided
from matching.engine.proposals import TopK
from matching.engine.votes import aligned, vote

MOST_PARTS = 8
MOST_WALLS = 200  # of a map that votes as a whole
MOST_PLACES = 40  # of each yaw mode
KEPT = 10  # placements of a part on each storey
SIGMA, SIGMA_ROUGH = 0.25, 0.4  # metres across
SHARPNESS = 1.0  # of a placement's odds for each unit of weight that it explains
FEW_CORNERS = 4
SMALL_PART = 4  # walls; smaller ones have too few corners to vote


def voting_proposals(s: SceneGraph, a: SceneGraph, scene: Scene) -> TopK:
    """Returns pairs of walls from placements of the map, and of its rooms with their neighbours, by voting."""
    score = np.zeros((len(scene.s), len(scene.plan)))
    for part in _parts(scene.groups):
        score[part] = np.maximum(score[part], _scores(scene, part))
    return TopK.of_dense(score)


def _parts(of: Groups) -> list[Index]:
    """The walls of the map, and of rooms with their neighbours, that cover it."""
    size = np.bincount(of.of_wall, minlength=len(of))
    near = of.hops <= 1
    free = np.ones(len(of), dtype=bool)
    parts = [np.arange(len(of.of_wall))] if len(of.of_wall) <= MOST_WALLS or len(of) < 3 else []
    while free.any() and len(parts) <= MOST_PARTS and len(of) > 2:
        best = int(np.argmax(np.where(free, near @ size, -1)))
        free &= ~near[best]
        parts.append(np.nonzero(near[best][of.of_wall])[0])
    return [p for p in parts if len(p) >= SMALL_PART or len(p) == len(of.of_wall)]


def _scores(scene: Scene, part: Index) -> Array:
    """(walls of the part, Na) how likely each pair is, by the part's placements, weighted by their odds."""
    walls, plan = scene.s[part], scene.plan
    score = np.zeros((len(part), len(plan)))
    own = corners(scene.s, part)
    scarce = len(own) < FEW_CORNERS
    own = corners(scene.s, part, scarce) if scarce else own
    storey, motion = [], []
    for k, a in enumerate(plan.storeys):
        motions = vote(own, corners(a, scarce=True) if scarce else plan.corners[k], MOST_PLACES)
        best = np.argsort(-aligned(walls, plan, k, motions, SIGMA_ROUGH), kind="stable")[:KEPT]
        motion.append(motions[best])
        storey += [k] * len(best)
    if not storey:
        return score
    fields = Fields(np.array(storey), rigid_state(scene, np.concatenate(motion)))
    used = np.isin(np.arange(len(scene.groups)), scene.groups.of_wall[part])
    sigmas = np.broadcast_to(np.where(used, SIGMA_ROUGH, np.inf), (1, len(fields), len(used)))
    placed = advance(scene, guided(scene, fields), np.ascontiguousarray(sigmas))
    quality = judge(scene, placed.table, placed.fields.state, SIGMA).quality[:, part]
    worth = quality.max(axis=2) @ walls.weight
    odds = np.exp(SHARPNESS * (worth - worth.max()))
    n, i, p = np.nonzero(quality)
    np.add.at(score, (i, placed.table[:, part][n, i, p]), (odds / odds.sum())[n] * quality[n, i, p])
    return score
