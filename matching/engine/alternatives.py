"""Alternative placements of a hypothesis: places where the plan looks like the one it explains.

The walls of the plan that the map explains are matched with the plan itself, without noise and deformation, by the same
corner votes that match a map. Every other place where they fit is an alternative, however the hypothesis was found.
"""

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index
from matching.engine.field import Fields, Scene, judge
from matching.engine.field_loops import of_direction, off_lines
from matching.engine.corners import corners
from matching.search.evidence import SEEN
from matching.engine.plan_walls import PlanWalls
from matching.search.scoring import FAR, SAME_DIRECTION, SIGMA_HEADING, SIGMA_SCORE
from matching.engine.votes import Marks, vote

PLACES, MOST_PLACES = 12, 192  # of each yaw mode; more if all of those fit
SIGMA = 0.4  # metres across: places that are alike, not equal
LEAST = 0.4  # of the walls' weight that must fit
ITSELF_M, ITSELF_RAD = 0.4, float(np.radians(4))  # closer ones are the place itself
EQUAL = 1e-9  # metres, radians
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
    most = most[_distinct_motions(at[most], motion[most])]
    return Fields(at[most], _moved(best.state[0], motion[most]))


def _distinct_motions(storey: Index, motion: Array) -> Index:
    """Indices of the first of equal motions: a place may be the peak of several bins of votes."""
    same = (np.abs(motion[:, None] - motion).max(axis=2) < EQUAL) & (storey[:, None] == storey)
    return np.flatnonzero(~(same & np.tri(len(same), k=-1, dtype=bool)).any(axis=1))


def _similar_places(
    plan: PlanWalls, home: int, used: Index, own: Marks, storey: int, places: int = PLACES
) -> tuple[Array, Array]:
    """Finds the places in a storey that look like some walls at home, given the corners of these.

    Returns (K,) the shares of the walls' weight that fit and (K, 3) the motions; their own place is left out.
    """
    voted = [c.motions for c in vote(own, plan.corners[storey], places)]
    if not voted:
        return np.zeros(0), np.zeros((0, 3))
    motions, a = np.concatenate(voted), plan.storeys[home]
    some = used[:: -(-len(used) // MOST_ASKED)]
    _, headings, lines = plan.by_heading
    own_lines, own_centre, weight = a.lines[some], a.centre[some], a.weight[some]
    stretch = int(plan.first[storey]), int(plan.first[storey + 1])
    worth = _explained(own_lines, own_centre, weight, headings, lines, stretch, motions) / weight.sum()
    if np.sum(worth > EQUALLY) >= places < MOST_PLACES:  # there may be more
        return _similar_places(plan, home, used, own, storey, 4 * places)
    alike = worth > LEAST
    if storey == home:
        middle = a.centre[used].mean(axis=0)
        off = np.hypot(*(se2.apply(motions, middle) - middle).T)
        alike &= (off >= ITSELF_M) | (np.abs(se2.wrap(motions[:, 0])) >= ITSELF_RAD)
    return worth[alike], motions[alike]


@compiled
def _explained(
    own: Array, centre: Array, weight: Array, headings: Array, lines: Array, storey: tuple[int, int], motions: Array
) -> Array:
    """(K,) weight of the walls that motions (K, 3) align with lines (6, N) of a storey, sorted by heading.

    Quality is as in `scoring.explained`; 0 if the weight is below the required one.
    """
    total, whole, off = np.zeros(len(motions)), weight.sum(), np.empty(storey[1] - storey[0])
    for k in range(len(motions)):
        yaw, shift_x, shift_y = motions[k]
        cos, sin, left = np.cos(yaw), np.sin(yaw), whole
        for i in range(len(own)):
            if total[k] + left < LEAST * whole:
                total[k] = 0.0
                break
            half, heading, best, span = own[i, 0], wrapped(own[i, 1] + yaw), 0.0, 1.6 * min(own[i, 0], 4.0)
            x, y = cos * centre[i, 0] - sin * centre[i, 1] + shift_x, sin * centre[i, 0] + cos * centre[i, 1] + shift_y
            stretch = of_direction(headings, storey[0], storey[1], heading, SAME_DIRECTION)
            for first, last in (stretch[:2], stretch[2:]):
                off_lines(lines, first, last, x, y, off)
                for n in range(first, last):
                    across = off[n - first]
                    if across >= FAR * SIGMA:
                        continue
                    along = abs(lines[2, n] * y - lines[3, n] * x - lines[5, n])
                    common = min(half + lines[0, n] - along, 2 * min(half, lines[0, n]))
                    beside = min(common / span, 1.0)
                    if beside > best:
                        turned = wrapped(heading - lines[1, n])
                        strange = (0.5 / SIGMA**2) * across**2 + (0.5 / SIGMA_HEADING**2) * turned**2
                        best = max(best, beside * np.exp(-strange))
            total[k] += weight[i] * best
            left -= weight[i]
    return total


def _moved(state: Array, motions: Array) -> Array:
    """(K, G, 3) the state (G, 3) after motions (K, 3) of the plan."""
    at = se2.apply(motions[:, None], state[:, 1:])
    return np.concatenate((se2.wrap(state[:, 0] + motions[:, :1])[..., None], at), axis=-1)
