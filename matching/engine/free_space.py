"""Free space as evidence: walls of the plan that would stand where rays of the map passed.

Equal rooms look alike at many places, but where a map of them ends, or is of another building, planned walls stand in
its free space.
"""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.arrays.free_space import STEP_M
from matching.arrays.walls import points_along
from matching.engine.evidence import SHOWN, seen_walls
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.hypotheses import Hypotheses

AT_EDGE = 0.25  # share of a wall that the coarse outline of a room may cover


def conflicts(found: Hypotheses) -> Array:
    """(K,) metres of planned walls without a partner that stand in the map's free space."""
    if not found.scene.s.free_space.inside.any():
        return np.zeros(len(found))
    quality = judge(found.scene, found.table, found.fields.state, SIGMA_SCORE).quality
    metres = []
    for k, storey in enumerate(found.fields.storey.tolist()):
        plan = found.scene.plan.storeys[storey]
        unseen = ~seen_walls(found.scene, storey, found.table[k], quality[k])
        chosen = np.flatnonzero(unseen & (4 * plan.half > SHOWN))
        metres.append(2 * float(plan.half[chosen] @ shares_in_map(found, k, chosen)))
    return np.array(metres)


def shares_in_map(found: Hypotheses, k: int, chosen: Index) -> Array:
    """(N,) the shares of chosen walls of a placement's storey that stand in the map's free space."""
    space, walls = found.scene.s.free_space, found.scene.plan.storeys[int(found.fields.storey[k])]
    if not len(chosen) or not space.inside.any():
        return np.zeros(len(chosen))
    count = np.ceil(2 * walls.half[chosen] / STEP_M).astype(np.int64) + 1
    points, of = points_along(walls.centre[chosen], walls.tangent[chosen], walls.half[chosen], count)
    inside = space.is_inside(se2.apply(se2.inverse(found.rigid[k]), points))
    return np.maximum(np.bincount(of, inside, len(chosen)) / count - AT_EDGE, 0.0) / (1 - AT_EDGE)
