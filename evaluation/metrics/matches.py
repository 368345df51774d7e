"""Quality of a matcher's answer, by the contract of `matches.json`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from data import SceneGraph
from data.common.errors import UserError
from data.geometry import se2
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_matches import TrueMatches, representatives
from matching.result import MatchResult, Pair

MISPLACED_M, TURNED_RAD = 0.5, float(np.radians(5))
MISPLACED_BENT_M, TURNED_BENT_RAD = 1.0, float(np.radians(8))


@dataclass(frozen=True)
class MatchingScores:
    """The scores of an answer's pairs, whatever its status."""

    rooms: Score
    wall_surfaces: Score


def matching_scores(result: MatchResult, truth: TrueMatches, s_graph: SceneGraph) -> MatchingScores:
    """Precision, recall and F1 of an answer's pairs.

    Several S surfaces (rooms) may be pieces of one A surface (room): the longest (largest) represents it and the others
    do not count. A pair for a node without a true match is wrong. Only `unique` answers are ever used; whether to count
    the pairs of others is up to the caller.

    Raises UserError if the answer or the truth has ids that are not in the S-graph, or the answer has an id twice.
    """
    rooms, walls = representatives(truth, s_graph)
    return MatchingScores(
        _score(result.rooms, truth.rooms, rooms, set(s_graph.room_by_id), "room"),
        _score(result.wall_surfaces, truth.wall_surfaces, walls, set(s_graph.surface_by_id), "wall surface"),
    )


def unique_is_wrong(result: MatchResult, truth: TrueMatches, warped: bool = False) -> bool:
    """Whether a `unique` answer is wrong; False for any other status.

    An answer is wrong if it misplaces the S-graph's centroid by more than 0.5 m or rotates it by more than 5 degrees (1
    m and 8 degrees for a deformed map, whose true T_a_s is the best rigid fit of the true matches), gives another
    floor, or matches one room wrongly.
    """
    if result.status != "unique":
        return False
    if result.T_a_s is None:
        raise UserError("matches: the answer is unique but has no T_a_s; correct the matcher")
    ours, true, centre = np.array(result.T_a_s), np.array(truth.T_a_s), np.array(truth.s_centroid)
    misplaced = np.hypot(*(se2.apply(ours, centre) - se2.apply(true, centre)))
    turned = abs(se2.wrap(ours[:1] - true[:1])[0])
    far, much = (MISPLACED_BENT_M, TURNED_BENT_RAD) if warped else (MISPLACED_M, TURNED_RAD)
    wrong_room = any(truth.rooms.get(s) != a for s, a, _ in result.rooms)
    return bool(not (misplaced <= far and turned <= much) or result.floor != truth.floor or wrong_room)


def _score(answer: tuple[Pair, ...], truth: Mapping[str, str], bearing: set[str], known: set[str], what: str) -> Score:
    ids = [s for s, _, _ in answer]
    if unknown := sorted((set(ids) | truth.keys()) - known):
        raise UserError(f"matches: no {what} '{unknown[0]}' in the S-graph")
    if len(set(ids)) < len(ids):
        raise UserError(f"matches: the {what} '{next(i for i in ids if ids.count(i) > 1)}' is answered twice")
    counted = [(s, a) for s, a, _ in answer if s in bearing or s not in truth]
    right = sum(truth.get(s) == a for s, a in counted)
    return Score(right, len(counted), right, len(bearing))
