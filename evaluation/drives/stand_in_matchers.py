"""Matchers for experiments: an oracle, and one that corrupts another matcher's answers."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from evaluation.metrics.true_matches import true_matches
from matching import Hypothesis, MatchResult
from matching.result import Pair
from sgslam.anchoring.floor_anchoring import AnyMatcher

Array = NDArray[np.float64]
LEAST_WALLS = 4


class OracleMatcher:
    """Returns the true matches, from the true T_bim_map (4, 4)."""

    def __init__(self, T_bim_map: Array, floor: str | None) -> None:
        self._T, self._floor = T_bim_map, floor

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """The true match of an S-graph; status `none` with too few walls."""
        truth = true_matches(s, a.on_floor(self._floor), self._T)
        if len(truth.wall_surfaces) < LEAST_WALLS:
            return MatchResult("none", f"fewer than {LEAST_WALLS} true matches so far")
        rooms = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.rooms.items())
        walls = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.wall_surfaces.items())
        sole = Hypothesis(0.0, truth.T_a_s, self._floor, tuple(truth.rooms.items()))
        return MatchResult("unique", "the truth was given", rooms, walls, truth.T_a_s, self._floor, (sole,))


class WrongMatches:
    """Another matcher's answers in which `count` rooms with all their walls are assigned to wrong planned rooms."""

    def __init__(self, matcher: AnyMatcher, count: int, seed: int) -> None:
        self._matcher, self._count, self._seed = matcher, count, seed

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """The corrupted answer; answers that are not unique are not changed."""
        answer = self._matcher.match(s, a)
        assert isinstance(answer, MatchResult)
        if answer.status != "unique" or answer.T_a_s is None:
            return answer
        rng = np.random.default_rng([self._seed, 13])
        planned = a.on_floor(answer.floor)
        spoiled: dict[str, str] = {}
        for k in rng.permutation(len(answer.rooms))[: self._count].tolist():
            s_room, a_room, _ = answer.rooms[k]
            others = [r.id for r in planned.rooms if r.id != a_room and len(planned.surfaces_of_room[r.id]) > 1]
            if others:
                spoiled[s_room] = others[int(rng.integers(len(others)))]
        rooms = tuple((room, spoiled.get(room, right), c) for room, right, c in answer.rooms)
        walls = tuple(_spoiled(pair, s, planned, spoiled, answer.T_a_s[0]) for pair in answer.wall_surfaces)
        return replace(answer, rooms=rooms, wall_surfaces=walls)


def _spoiled(pair: Pair, s: SceneGraph, a: SceneGraph, spoiled: dict[str, str], yaw: float) -> Pair:
    """Assigns the wall of a corrupted room to the wrong room's surface with the most similar normal."""
    surface = s.surface_by_id[pair[0]]
    if surface.room not in spoiled:
        return pair
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    normal = turn @ surface.normal
    wrong = max(a.surfaces_of_room[spoiled[surface.room]], key=lambda w: float(normal @ w.normal))
    return (pair[0], wrong.id, pair[2])
