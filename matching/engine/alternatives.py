"""Alternative placements of a hypothesis: places where the plan looks like the one it explains.

The walls of the plan that the map explains are matched with the plan itself, without noise and deformation, by the same
corner votes that match a map. Every other place where they fit is an alternative, however the hypothesis was found.
"""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.corners import Marks, corners
from matching.engine.evidence import SEEN
from matching.engine.field import Fields, Scene, judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.plan_walls import PlanWalls
from matching.engine.votes import aligned, candidates, corner_votes

PLACES, MOST_PLACES = 12, 192  # of each yaw mode; more if all of those fit
SIGMA = 0.4  # metres across: places that are alike, not equal
LEAST = 0.4  # of the walls' weight that must fit
ITSELF_M, ITSELF_RAD = 0.4, float(np.radians(4))  # closer ones are the place itself
MOST, EQUALLY, MOST_EQUAL = 6, 0.9, 120  # all that fit this well are kept: only doors distinguish equal rooms
LEAST_WALLS, MOST_WALLS = 3, 200  # walls of the place that are used,
MOST_CORNERS, MOST_ASKED = 80, 40  # corners that vote, and walls that check a place


def alternative_placements(scene: Scene, best: Fields, table: Index) -> Fields:
    """Returns the best field (K = 1) moved to all places where the plan looks alike; `table` (Ns, P) are its
    partners.
    """
    storey, plan = int(best.storey[0]), scene.plan
    quality = judge(scene, table[None], best.state, SIGMA_SCORE).quality[0]
    used = np.unique(table[quality > SEEN]) - int(plan.first[storey])
    used = used[:: -(-len(used) // MOST_WALLS) or 1]
    if len(used) < LEAST_WALLS:
        return Fields(np.zeros(0, dtype=np.int64), np.zeros((0, *best.state.shape[1:])))
    own = corners(plan.storeys[storey], used)
    own = own[:: -(-len(own) // MOST_CORNERS) or 1]
    found = [_similar_places(plan, storey, used, own, st) for st in range(len(plan.storeys))]
    worth, motion = (np.concatenate([f[n] for f in found]) for n in (0, 1))
    at = np.repeat(np.arange(len(found)), [len(f[0]) for f in found])
    most = np.argsort(-worth, kind="stable")[: max(MOST, min(int(np.sum(worth > EQUALLY)), MOST_EQUAL))]
    return Fields(at[most], _moved(best.state[0], motion[most]))


def _similar_places(
    plan: PlanWalls, home: int, used: Index, own: Marks, storey: int, places: int = PLACES
) -> tuple[Array, Array]:
    """Finds the places in a storey that look like some walls at home, given the corners of these.

    Returns (K,) the shares of the walls' weight that fit and (K, 3) the motions; their own place is left out.
    """
    motions, a = candidates(corner_votes(own, plan.corners[storey]), places), plan.storeys[home]
    worth = aligned(a[used[:: -(-len(used) // MOST_ASKED)]], plan, storey, motions, SIGMA, LEAST)
    if np.sum(worth > EQUALLY) >= places < MOST_PLACES:  # there may be more
        return _similar_places(plan, home, used, own, storey, 4 * places)
    alike = worth > LEAST
    if storey == home:
        middle = a.centre[used].mean(axis=0)
        off = np.hypot(*(se2.apply(motions, middle) - middle).T)
        alike &= (off >= ITSELF_M) | (np.abs(se2.wrap(motions[:, 0])) >= ITSELF_RAD)
    return worth[alike], motions[alike]


def _moved(state: Array, motions: Array) -> Array:
    """(K, G, 3) the state (G, 3) after motions (K, 3) of the plan."""
    at = se2.apply(motions[:, None], state[:, 1:])
    return np.concatenate((se2.wrap(state[:, 0] + motions[:, :1])[..., None], at), axis=-1)
