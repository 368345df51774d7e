"""What must not matter to a matcher, whatever proposes: frames, the order of nodes, and what stands far away."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, flat, merged, moved, offices

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher, MatchResult
from matching.arrays import storeys
from matching.deformation import DeformableMatcher
from matching.search.voting_proposals import voting_proposals

MATCHERS = {name: Matcher.load(name) for name in ("learned", "voting")}
MATCHERS["voted"] = Matcher(DeformableMatcher(voting_proposals))
PLANS = {
    "flat": a_graph(flat(np.random.default_rng(5)), "ground"),
    "offices": a_graph(offices([3.1, 4.2, 2.7, 5.0, 3.6], [4.4, 3.0, 6.1, 5.2]), "ground"),
}
OTHER = a_graph(flat(np.random.default_rng(6)), "ground", "far/")
FAR = moved(OTHER, 0.3, 700.0, -400.0)
CASES = [
    ("learned", plan, noise, rooms)
    for plan in PLANS
    for noise, rooms in (("real", 3), ("drift", 6), ("mis_segmented", 5), ("paper", None))
] + [(method, "flat", noise, 6) for method in ("voting", "voted") for noise in ("real", "drift")]
Case = tuple[Matcher, SceneGraph, DrawnGraph, MatchResult]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request: pytest.FixtureRequest) -> Case:
    method, plan, noise, rooms = request.param
    drawn = draw(PLANS[plan], noise, np.random.default_rng(1), rooms)
    return MATCHERS[method], PLANS[plan], drawn, MATCHERS[method].match(drawn.s_graph, PLANS[plan])


def assert_same(before: MatchResult, after: MatchResult, expected: se2.Array) -> None:
    """The same pairs and status; the motion is the `expected` one, or none as before."""
    assert after.status == before.status and after.floor == before.floor
    for of in ("rooms", "wall_surfaces"):
        pairs = [{(s, a): c for s, a, c in getattr(result, of)} for result in (before, after)]
        assert pairs[0].keys() == pairs[1].keys()
        assert pairs[1] == pytest.approx(pairs[0], abs=0.02)
    T_a_s = np.array(after.hypotheses[0].T_a_s)
    assert abs(se2.wrap(T_a_s[:1] - expected[:1])[0]) < 1e-3
    assert np.hypot(*(T_a_s - expected)[1:]) < 0.02
    assert after.hypotheses[0].score == pytest.approx(before.hypotheses[0].score, abs=0.5)


@pytest.mark.parametrize("of", ["map", "plan"])
def test_the_frames_may_lie_anywhere(case: Case, of: str) -> None:
    matcher, plan, drawn, before = case
    T = np.array([2.3, 310.0, -45.0])
    T_a_s = np.array(before.hypotheses[0].T_a_s)
    if of == "map":
        after, expected = matcher.match(moved(drawn.s_graph, *T), plan), se2.compose(T_a_s, se2.inverse(T))
    else:
        after, expected = matcher.match(drawn.s_graph, moved(plan, *T)), se2.compose(T, T_a_s)
    assert_same(before, after, expected)


def test_the_order_of_nodes_tells_nothing(case: Case) -> None:
    matcher, plan, drawn, before = case
    rng = np.random.default_rng(0)

    def shuffled(graph: SceneGraph) -> SceneGraph:
        rooms = tuple(graph.rooms[k] for k in rng.permutation(len(graph.rooms)))
        walls = tuple(graph.wall_surfaces[k] for k in rng.permutation(len(graph.wall_surfaces)))
        return replace(graph, rooms=rooms, wall_surfaces=walls)

    after = matcher.match(shuffled(drawn.s_graph), shuffled(plan))
    assert_same(before, after, np.array(before.hypotheses[0].T_a_s))


@pytest.mark.parametrize("at", [(700.0, -400.0), (80_000.0, -20_000.0)])
def test_a_building_far_away_changes_nothing(case: Case, at: tuple[float, float]) -> None:
    matcher, plan, drawn, before = case
    site = merged(moved(OTHER, 0.3, *at), plan)
    assert_same(before, matcher.match(drawn.s_graph, site), np.array(before.hypotheses[0].T_a_s))


def test_land_that_is_not_built_on_does_not_count() -> None:
    alone, far = PLANS["flat"], FAR
    (one,), (other,), (site,) = (storeys(g) for g in (alone, far, merged(far, alone)))
    assert site.area == pytest.approx(one.area + other.area, rel=1e-6)
    assert len(site.building_areas) == 2 and len(one.building_areas) == 1
    hall = a_graph([[(0, 0), (90, 0), (90, 60), (0, 60)]])
    assert storeys(hall)[0].area == pytest.approx(91 * 61)
