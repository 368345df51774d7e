"""Where else a hypothesis may lie: the plan's own likenesses of the place.

What the map explains of the plan is laid upon the plan itself, without noise and without bend, by the same votes of
corners that match a map. Every other place where it fits is a rival, however the first one was found.
"""

from dataclasses import replace

import numpy as np

from matching import se2
from matching.corners import corners
from matching.evidence import SEEN
from matching.field import Fields, Scene, judge
from matching.scoring import SIGMA_SCORE, explained
from matching.se2 import Array
from matching.voting import Marks, vote
from matching.walls import Index, Walls

MOST_PLACES = 12  # of each yaw mode
SIGMA = 0.4  # metres across: places that are alike, not equal
LEAST = 0.4  # of the walls' weight that a likeness explains
MOST = 6
LEAST_WALLS, MOST_WALLS = 3, 200  # of the place, that are laid elsewhere,
MOST_CORNERS, MOST_ASKED = 80, 40  # of which vote, and are asked whether they lie well there


def rivals(scene: Scene, best: Fields, table: Index) -> Fields:
    """Fields that are the best one (K = 1), moved to where the plan is alike; `table` (Ns, P) its partners."""
    storey = int(best.storey[0])
    home, first = scene.plan.storeys[storey], int(scene.plan.first[storey])
    quality = judge(scene, table[None], best.state, SIGMA_SCORE).quality[0]
    used = np.unique(table[quality > SEEN]) - first
    used = used[:: -(-len(used) // MOST_WALLS) or 1]
    if len(used) < LEAST_WALLS:
        return Fields(np.zeros(0, dtype=np.int64), np.zeros((0, *best.state.shape[1:])))
    part = _part(home, used)
    of_plan = list(zip(scene.plan.storeys, scene.plan.corners, strict=True))
    found = [(w, st, m) for st, (a, marks) in enumerate(of_plan) for w, m in _likenesses(part, a, marks, st == storey)]
    found = sorted(found, key=lambda f: -f[0])[:MOST]
    states = [_moved(scene, best.state[0], m) for _, _, m in found]
    shape = (0, *best.state.shape[1:])
    return Fields(np.array([st for _, st, _ in found], dtype=np.int64), np.array(states).reshape(-1, *shape[1:]))


def _part(a: Walls, used: Index) -> Walls:
    return replace(
        a, ids=tuple(a.ids[j] for j in used), centre=a.centre[used], heading=a.heading[used], half=a.half[used],
        known=a.known[used], room=a.room[used],
    )  # fmt: skip


def _likenesses(part: Walls, a: Walls, of_a: Marks, at_home: bool) -> list[tuple[float, Array]]:
    """(share explained, motion (3,)) of the places in a storey that are like the part, its own place aside."""
    found: list[tuple[float, Array]] = []
    middle, own = part.centre.mean(axis=0), corners(part)
    own = own[:: -(-len(own) // MOST_CORNERS) or 1]
    some = _part(part, np.arange(0, len(part), -(-len(part) // MOST_ASKED)))
    for voted in vote(own, of_a, MOST_PLACES):
        worth = explained(some, a, voted.yaw, voted.motions, SIGMA) / some.weight.sum()
        for w, m in zip(worth.tolist(), voted.motions, strict=True):
            off = np.hypot(*(se2.apply(m, middle) - middle))
            itself = at_home and off < 0.4 and abs(se2.wrap(m[:1])[0]) < np.radians(4)
            if w > LEAST and not itself:
                found.append((w, m))
    return found


def _moved(scene: Scene, state: Array, motion: Array) -> Array:
    """(G, 3) the state after a motion of the plan."""
    at = se2.apply(motion, state[:, 1:])
    return np.column_stack((se2.wrap(state[:, 0] + motion[0]), at))
