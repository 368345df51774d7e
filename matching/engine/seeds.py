"""Seeds: motions of parts of the map, from which hypotheses grow.

A part is a room with its direct neighbours, whose motions differ little, however much the whole map has drifted. Its
corners vote for motions; those that align most of its walls with the plan's are its seeds.
"""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.arrays.groups import Groups
from matching.engine.corners import corners
from matching.engine.field import Fields, Scene, explained, rigid_state
from matching.engine.field_loops import wrapped
from matching.engine.guided_field import advance, guided
from matching.engine.votes import Votes, aligned, candidates, corner_votes

MOST_PARTS = 8  # beside the whole map
SMALL_PART, MOST_WALLS = 4, 200  # walls; a part with fewer has too few corners to vote, a map with more drifts
MOST_PLACES, KEPT = 40, 10  # of each yaw mode; of a part on each storey
SIGMA, SIGMA_WORTH = 0.4, 0.25  # metres across: neighbours' motions differ; after a step
LEAST_WORTH = 0.25  # of the best seed's; beyond the fewest, others are no seeds
SAME_M, SAME_RAD = 0.4, float(np.radians(4))  # between the motions of a room that two seeds of it are one


def seeds(scene: Scene, fewest: int, most: int) -> tuple[Fields, Index]:
    """Returns the best distinct motions as rigid fields, best first, and for each (K,) the group in the part's
    middle."""
    group, found, worth = [], [], []
    for middle, member in _parts(scene.groups):
        placed, explains = _placements(scene, middle, member)
        group.append(np.full(len(placed), middle))
        found.append(placed)
        worth.append(explains)
    of, value = np.concatenate(group), np.concatenate(worth)
    fields = Fields(np.concatenate([f.storey for f in found]), np.concatenate([f.state for f in found]))
    order = np.argsort(-value, kind="stable")
    kept = order[
        _distinct(scene.groups.hops, of[order], fields.storey[order], fields.state[order], value[order], fewest, most)
    ]
    return fields[kept], of[kept]


def _placements(scene: Scene, middle: int, member: NDArray[np.bool_]) -> tuple[Fields, Array]:
    """The likeliest placements of a part on each storey, after a step, and the weight of its walls that each
    explains."""
    plan, chosen = scene.plan, np.flatnonzero(member[scene.groups.of_wall])
    walls, own = scene.s[chosen], corners(scene.s, chosen)
    storey, motion = [], []
    for k in range(len(plan.storeys)):
        found = _about(scene.groups.centre[middle], corner_votes(own, plan.corners[k]))
        best = np.argsort(-aligned(walls, plan, k, found, SIGMA), kind="stable")[:KEPT]
        motion.append(found[best])
        storey.append(np.full(len(best), k))
    rigid = Fields(np.concatenate(storey), rigid_state(scene, np.concatenate(motion)))
    sigmas = np.broadcast_to(np.where(member, SIGMA, np.inf), (1, len(rigid), len(member)))
    placed = advance(scene, guided(scene, rigid), np.ascontiguousarray(sigmas))
    return placed.fields, explained(scene, placed.table, placed.fields.state, SIGMA_WORTH)[:, chosen] @ walls.weight


def _about(centre: Array, votes: Votes) -> Array:
    """(K, 3) the motions with most votes, gathered at a point of the map, where a small turn does not move it."""
    found = candidates(votes._replace(point=votes.point - centre), MOST_PLACES)
    found[:, 1:] -= se2.rotate(found[:, 0], centre)
    return found


def _parts(groups: Groups) -> list[tuple[int, NDArray[np.bool_]]]:
    """The group in the middle of each part, and which groups (G,) are members; the parts cover the map, and the first
    is the whole map, unless it is large and has others."""
    size, near = np.bincount(groups.of_wall, minlength=len(groups)), groups.hops <= 1
    whole = int(np.argmin(np.linalg.norm(groups.centre, axis=1))), np.ones(len(groups), dtype=bool)
    parts = [whole] if size.sum() <= MOST_WALLS or len(groups) < 3 else []
    free = np.ones(len(groups), dtype=bool)
    while free.any() and len(parts) <= MOST_PARTS and len(groups) > 2:
        best = int(np.argmax(np.where(free, near @ size, -1)))
        free &= ~near[best]
        if size[near[best]].sum() >= SMALL_PART:
            parts.append((best, near[best]))
    return parts or [whole]


@compiled
def _distinct(hops: Index, group: Index, storey: Index, state: Array, worth: Array, fewest: int, most: int) -> Index:
    """Indices of the seeds that differ from all better ones in their middle, at least `fewest` and at most `most`."""
    kept, count = np.empty(most, dtype=np.int64), 0
    for n in range(len(worth)):
        if count == most or (count >= fewest and worth[n] < LEAST_WORTH * worth[0]):
            break
        g, new = group[n], True
        for m in kept[:count]:
            slack = np.sqrt(1.0 + hops[g, group[m]])
            near = np.hypot(state[m, g, 1] - state[n, g, 1], state[m, g, 2] - state[n, g, 2]) < SAME_M * slack
            near = near and abs(wrapped(state[m, g, 0] - state[n, g, 0])) < SAME_RAD * slack
            new = new and not (near and storey[m] == storey[n])
        if new:
            kept[count] = n
            count += 1
    return kept[:count].copy()
