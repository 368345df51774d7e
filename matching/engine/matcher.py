"""`GeometricMatcher`: places a map by a field of motions, starting from the votes of corners."""

import functools
import time
from collections.abc import Callable

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import PlanCache
from matching.engine.assignment import Pairs, assign
from matching.engine.evidence import homes
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import SURE, Signs, ranked, shipped, verify
from matching.result import Hypothesis, MatchResult, Start, near_start

LISTED = 10  # hypotheses in the result, at most
PlaceJudge = Callable[[Hypotheses, Signs], Array]  # (K,) the probability of each hypothesis


class GeometricMatcher:
    """Implements `Matcher.match`; the map may deform from room to room. Without a `judge` the evidence alone gives the
    probabilities."""

    def __init__(self, judge: PlaceJudge | None = None) -> None:
        self._judge = judge
        self._plan = PlanCache(PlanWalls.of)

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`."""
        began = time.perf_counter()
        plan = self._plan(a) if floor is None else PlanWalls.of(a, floor)
        if not s.wall_surfaces or plan is None:
            return MatchResult("none", f"the {'A' if s.wall_surfaces else 'S'}-graph has no wall surface")
        allowed = None if start is None else functools.partial(near_start, start)
        found = search(scene_of(s, plan), allowed)
        if len(found):
            return answer(found, began, start is not None, self._judge)
        near = "" if start is None else " near the start that was given (its yaw is in radians)"
        reason = f"no wall corner of the map matches one in the plan{near}"
        return MatchResult("none", reason, seconds=time.perf_counter() - began)


def answer(found: Hypotheses, began: float, near_start: bool = False, judging: PlaceJudge | None = None) -> MatchResult:
    """Returns the result of hypotheses, best first; at least one. `near_start`: they were looked for only near a
    start that was given. Hypotheses come the likeliest first."""
    s, of = found.scene.s, shipped()
    found, signs = ranked(found, near_start)
    likely = of.probabilities(signs) if judging is None else judging(found, signs)
    if judging is not None:
        order = np.argsort(-likely, kind="stable")
        found, signs, likely = found[order], signs[order], likely[order]
    temperature = of.temperature(signs, is_mirrored=True)
    score = found.score + temperature * signs.of_free_space
    pairs = assign(found, 0)
    # A room of a map that deforms may lie on its neighbour of the plan: only what is sure is named.
    named = zip(pairs.rooms, of.of_rooms(room_signs(found, pairs.rooms)), strict=True)
    pairs = Pairs(tuple((r, q, known) for (r, q, _), known in named if known >= SURE), pairs.surfaces)
    verdict = verify(found, pairs, likely, temperature)
    hypotheses, listed = [], found[np.arange(min(len(found), LISTED))]
    now = judge(found.scene, listed.table, listed.fields.state, SIGMA_SCORE)
    for k, home in enumerate(homes(found.scene, listed.table, now.quality).tolist()):
        storey = found.scene.plan.storeys[int(found.fields.storey[k])]
        matches = [(r, q) for r, q in enumerate(home) if q >= 0] if k else [(r, q) for r, q, _ in pairs.rooms]
        rooms = tuple((s.rooms[r].id, storey.rooms[q].id) for r, q in matches)
        chance = verdict.probabilities[k]
        hypotheses.append(Hypothesis(float(score[k]), _triple(found, k), storey.floor, rooms, chance))
    a = found.scene.plan.storeys[int(found.fields.storey[0])]
    sure = verdict.probabilities[0]
    return MatchResult(
        verdict.status, verdict.reason,
        tuple((s.rooms[r].id, a.rooms[q].id, sure * c) for r, q, c in pairs.rooms),
        tuple((s.ids[i], a.ids[j], sure * of.of_surface(c)) for i, j, c in pairs.surfaces),
        None if verdict.status == "none" else _triple(found, 0), a.floor, tuple(hypotheses),
        time.perf_counter() - began, verdict.temperature,
    )  # fmt: skip


def _triple(found: Hypotheses, k: int) -> tuple[float, float, float]:
    yaw, x, y = found.between_graphs[k].tolist()
    return yaw, x, y
