"""The method `oracle`: gets each room's true motion and assigns walls and rooms like our matchers.

It misses what this assignment cannot find because of the noise: walls next to a wrong wall or to none although the room
is at its true place. It is not an upper bound: a method may use more than positions.
"""

import time

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph
from matching.arrays import Walls, arrays, storeys
from matching.result import Hypothesis, MatchResult
from matching.search.assignment import assign
from matching.search.hypotheses import Placement, groups_of
from matching.search.scoring import SIGMA_SCORE, Pairing, fit


def oracle_match(drawn: DrawnGraph, a: SceneGraph) -> MatchResult:
    """The oracle's answer for an S-graph with known truth and its A-graph; `none` only if the true floor has no walls.

    A surface without a room moves with the nearest one that has a room; a room with unknown motion moves with the map.
    """
    began = time.perf_counter()
    s = arrays(drawn.s_graph, None, list(drawn.s_graph.wall_surfaces))
    storey = next((w for w in storeys(a) if w.floor == drawn.floor), None)
    if storey is None:
        return MatchResult("none", "the true floor has no wall surface")
    pairs = assign(_true_placement(drawn, s, storey))
    rooms = tuple((s.rooms[r].id, storey.rooms[q].id, c) for r, q, c in pairs.rooms)
    walls = tuple((s.ids[i], storey.ids[j], c) for i, j, c in pairs.surfaces)
    sole = Hypothesis(0.0, drawn.T_a_s, storey.floor, tuple((r, q) for r, q, _ in rooms))
    seconds = time.perf_counter() - began
    return MatchResult("unique", "the true place was given", rooms, walls, drawn.T_a_s, storey.floor, (sole,), seconds)


def _true_placement(drawn: DrawnGraph, s: Walls, storey: Walls) -> Placement:
    group = groups_of(s)
    T_own_a = se2.inverse(storey.T_graph_own)
    motion = se2.compose(se2.compose(T_own_a, np.array(drawn.T_a_s)), s.T_graph_own)
    pairing = Pairing.near(s, storey, float(motion[0]), group)
    state = np.empty((1, len(pairing.centre), 3))
    for g, centre in enumerate(pairing.centre):
        with_room = s.room[(group == g) & (s.room >= 0)]
        T_a_s = drawn.T_a_s_by_room.get(s.rooms[with_room[0]].id, drawn.T_a_s) if len(with_room) else drawn.T_a_s
        T = se2.compose(se2.compose(T_own_a, np.array(T_a_s)), s.T_graph_own)
        state[0, g] = T[0], *se2.apply(T, centre)
    return Placement(storey, motion, np.array(drawn.T_a_s), pairing, state, fit(pairing, state, SIGMA_SCORE), 0.0)
