"""Where the map has drifted: walls that are off the plan together with their neighbours have not been built elsewhere."""

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring.se2_consensus import Consensus, Flags, Pairs, find_consensus

_NEIGHBOURS = 6.0  # m
_MOST_OVERALL = 0.5  # of the votes there for the map's own place; where there are more, the map has not drifted
_LEAST_LOCAL = 0.7  # of the votes there for one place of their own
_LEAST_UNITS = 5
_PARALLEL = np.cos(np.radians(15.0))
_LEAST_TELLING = 3  # units among them that would not agree with the map's own place


def drifted_neighbourhoods(pairs: Pairs, overall: Consensus, max_turn: float, deviating: Flags) -> Flags:
    """(N,) the walls off the `overall` consensus whose neighbourhood agrees on a place of its own.

    Walls that were built elsewhere, and wrong matches, are each off in their own way; drift moves all walls of a
    neighbourhood alike. Those `deviating` (N,) are known to stand elsewhere, and say nothing of the map.
    `max_turn` in radians, as in `find_consensus`.
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
        # walls along the shift agree with both places; only those across it tell that the map has drifted
        informative = np.abs(pairs.offsets(local.T_plan_map) - pairs.offsets(overall.T_plan_map))[near] > overall.gate
        for_it = near[informative & local.agree]
        if votes[for_it].sum() < _LEAST_LOCAL * votes[near][informative].sum():
            continue
        if len(np.unique(pairs.unit[for_it])) >= _LEAST_TELLING:
            drifted[agreeing] = True
    return drifted & ~overall.agree


def drifted_rooms(pairs: Pairs, overall: Consensus, room: NDArray[np.int64], deviating: Flags) -> Flags:
    """(N,) the walls of rooms (N,) that are off alike on both sides: where the step into a room was wrong along it, all
    that it has in that direction is, and its walls along the step agree with every place. Below 0 is no room."""
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
