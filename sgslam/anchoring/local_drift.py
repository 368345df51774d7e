"""Local drift: walls that are off the plan together with their neighbours were not built elsewhere."""

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring.se2_consensus import Consensus, Flags, Pairs, find_consensus

_NEIGHBOURS = 6.0  # m
_MOST_OVERALL = 0.5  # share of a neighbourhood's votes for the overall place; with more, the map has not drifted
_LEAST_LOCAL = 0.7  # share of its votes for a place of its own
_LEAST_UNITS = 5
_PARALLEL = np.cos(np.radians(15.0))
_LEAST_TELLING = 3  # of these units that do not agree with the overall place


def drifted_neighbourhoods(pairs: Pairs, overall: Consensus, max_turn: float, deviating: Flags) -> Flags:
    """(N,) flags of the walls that are off the `overall` consensus because the map has drifted there.

    Drift shifts all walls of a neighbourhood by the same motion, so they agree on a place of their own. Walls that were
    built elsewhere, and wrong matches, do not. Walls that are `deviating` (N,) are known to stand elsewhere and are
    left out. `max_turn` (rad) as in `find_consensus`.
    """
    drifted = np.zeros(len(overall.agree), dtype=bool)
    votes = pairs.votes()
    for i in np.argsort(-votes, kind="stable").tolist():
        if overall.agree[i] or drifted[i] or deviating[i]:
            continue
        near = np.flatnonzero((np.hypot(*(pairs.seen - pairs.seen[i]).T) < _NEIGHBOURS) & ~deviating)
        if votes[near][overall.agree[near]].sum() > _MOST_OVERALL * votes[near].sum():
            continue
        local = find_consensus(pairs.only(near), overall.T_plan_map, max_turn)
        if local is None or local.share < _LEAST_LOCAL:
            continue
        agreeing = near[local.agree]
        if len(np.unique(pairs.unit[agreeing])) < _LEAST_UNITS:
            continue
        # walls along the shift agree with both places; only those across it show the drift
        informative = np.abs(pairs.offsets(local.T_plan_map) - pairs.offsets(overall.T_plan_map))[near] > overall.gate
        for_it = near[informative & local.agree]
        if votes[for_it].sum() < _LEAST_LOCAL * votes[near][informative].sum():
            continue
        if len(np.unique(pairs.unit[for_it])) >= _LEAST_TELLING:
            drifted[agreeing] = True
    return drifted & ~overall.agree


def drifted_rooms(pairs: Pairs, overall: Consensus, room: NDArray[np.int64], deviating: Flags) -> Flags:
    """(N,) flags of the walls of whole rooms that have drifted.

    Where the step into a room was wrong, all its walls across the step are off by the same shift, on both sides, and
    its walls along the step agree with any place. `room` (N,) numbers the rooms, negative for none.
    """
    drifted = np.zeros(len(overall.agree), dtype=bool)
    off = pairs.offsets(overall.T_plan_map)
    for i in np.flatnonzero(~overall.agree & ~deviating & (room >= 0)).tolist():
        cosine = pairs.planned_normal @ pairs.planned_normal[i]
        of_room = np.flatnonzero((room == room[i]) & (np.abs(cosine) > _PARALLEL))
        opposite = cosine[of_room] < 0
        shift = np.where(opposite, -off[of_room], off[of_room])
        alike = np.abs(shift - off[i]) < overall.gate
        if opposite.any() and alike.all() and not (overall.agree | deviating)[of_room].any():
            drifted[of_room] = True
    return drifted
