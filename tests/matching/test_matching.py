"""The voting matcher on plans and maps whose truth is known."""

import dataclasses
import math

import numpy as np
import pytest
from plans import a_graph, box, flat, merged, moved, offices

from data import SceneGraph, UserError, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher, MatchResult

MATCHER = Matcher.load()
PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
OTHER = a_graph(flat(np.random.default_rng(4)), "ground", "other")


@pytest.fixture(scope="module")
def drawn() -> DrawnGraph:
    return draw(PLAN, "real", np.random.default_rng(1), 5)


def misplaced(result: MatchResult, truth: DrawnGraph) -> tuple[float, float]:
    """Metres at the S-graph's centroid, radians."""
    T_a_s = np.array(result.hypotheses[0].T_a_s)
    centre = truth.s_graph.centroid()
    off = np.hypot(*(se2.apply(T_a_s, centre) - se2.apply(np.array(truth.T_a_s), centre)))
    return float(off), abs(float(se2.wrap(T_a_s[:1] - truth.T_a_s[0])[0]))


def pairs(result: MatchResult) -> set[tuple[str, str]]:
    return {(s, a) for s, a, _ in (*result.rooms, *result.wall_surfaces)}


def share_right(result: MatchResult, truth: DrawnGraph) -> float:
    return sum(truth.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces) / len(truth.wall_surfaces)


def same_graph(graph: SceneGraph, **parts: object) -> SceneGraph:
    return dataclasses.replace(graph, **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize(("noise", "limit_m", "limit_deg"), [("real", 0.2, 2), ("drift", 0.6, 5)])
def test_finds_the_place_of_a_map_with_the_noise_of_real_scans(noise, limit_m, limit_deg):
    for seed in range(6):
        truth = draw(PLAN, noise, np.random.default_rng(seed), 6)
        result = MATCHER.match(truth.s_graph, PLAN)
        off, turned = misplaced(result, truth)
        assert result.status == "unique", result.reason
        assert off < limit_m and turned < math.radians(limit_deg)
        assert {(s, a) for s, a, _ in result.rooms} == set(truth.rooms.items())
        assert share_right(result, truth) > 0.85


def test_gives_the_same_answer_twice(drawn):
    assert MATCHER.match(drawn.s_graph, PLAN) == MATCHER.match(drawn.s_graph, PLAN)


def test_another_building_is_never_unique():
    for seed in range(8):
        truth = draw(PLAN, "real", np.random.default_rng(seed), 3 + seed % 4)
        assert MATCHER.match(truth.s_graph, OTHER).status != "unique"


def test_the_mirror_image_is_never_unique():
    mirrored = moved(PLAN, 0.4, 5.0, 1.0, mirror=True)
    for seed in range(6):  # so many rooms that they are no mirror image of themselves
        truth = draw(PLAN, "real", np.random.default_rng(seed), 9)
        assert MATCHER.match(truth.s_graph, mirrored).status != "unique"


def test_finds_the_storey():
    upper = a_graph(flat(np.random.default_rng(4)), "upper", "upper")
    for seed in range(4):
        truth = draw(upper, "real", np.random.default_rng(seed), 5)
        result = MATCHER.match(truth.s_graph, merged(PLAN, upper))
        assert (result.status, result.floor) == ("unique", "upper")


def test_equal_storeys_are_ambiguous_until_the_storey_is_known(drawn):
    symmetry = a_graph(flat(np.random.default_rng(3)), "upper", "upper")
    tower = merged(PLAN, symmetry)
    result = MATCHER.match(drawn.s_graph, tower)
    assert result.status == "ambiguous"
    assert "2 storeys" in result.reason
    assert {h.floor for h in result.hypotheses[:2]} == {"ground", "upper"}
    known = MATCHER.match(drawn.s_graph, tower, floor="upper")
    assert (known.status, known.floor) == ("unique", "upper")
    assert all(a.startswith("upper") for _, a, _ in known.rooms)


def test_a_rough_start_decides_between_equal_places():
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    truth = draw(row, "real", np.random.default_rng(2), 4)
    assert MATCHER.match(truth.s_graph, row).status == "ambiguous"
    yaw, x, y = truth.T_a_s
    result = MATCHER.match(truth.s_graph, row, start=(x + 0.7, y - 0.5, yaw + 0.3))
    assert result.status == "unique" and misplaced(result, truth)[0] < 0.3
    assert MATCHER.match(truth.s_graph, row, start=(x + 500, y, yaw)).status == "none"


def test_one_room_is_not_enough():
    room = draw(PLAN, "real", np.random.default_rng(0), 1).s_graph
    result = MATCHER.match(room, PLAN)
    assert result.status != "unique"
    assert result.reason


def test_walls_without_rooms_are_enough(drawn):
    def bare(graph):
        walls = tuple(dataclasses.replace(w, room=None) for w in graph.wall_surfaces)
        return same_graph(graph, rooms=(), doors=(), wall_surfaces=walls)

    for s, a in ((bare(drawn.s_graph), PLAN), (drawn.s_graph, bare(PLAN)), (bare(drawn.s_graph), bare(PLAN))):
        result = MATCHER.match(s, a)
        assert result.status == "unique" and result.rooms == ()
        assert misplaced(result, drawn)[0] < 0.2
        assert share_right(result, drawn) > 0.8


@pytest.mark.parametrize("of", ["map", "plan", "both"])
def test_lengths_may_be_unknown(drawn, of):
    def unmeasured(graph):
        walls = tuple(dataclasses.replace(w, length=None) for w in graph.wall_surfaces)
        return same_graph(graph, wall_surfaces=walls)

    s = drawn.s_graph if of == "plan" else unmeasured(drawn.s_graph)
    a = PLAN if of == "map" else unmeasured(PLAN)
    result = MATCHER.match(s, a)
    assert misplaced(result, drawn)[0] < 0.3
    assert share_right(result, drawn) > 0.7
    assert result.status != "none"


def test_a_wall_seen_in_pieces_matches_one_wall_of_the_plan(drawn):
    longest = max((w for w in drawn.s_graph.wall_surfaces if w.id in drawn.wall_surfaces), key=lambda w: w.length)
    (x0, y0), (x1, y1) = longest.ends()

    def piece(name, at):
        centre = (x0 + at * (x1 - x0), y0 + at * (y1 - y0))
        return dataclasses.replace(longest, id=name, centroid=centre, length=0.4 * longest.length)

    others = tuple(w for w in drawn.s_graph.wall_surfaces if w is not longest)
    cut = same_graph(drawn.s_graph, wall_surfaces=(*others, piece("left", 0.2), piece("right", 0.8)))
    answer = {s: a for s, a, _ in MATCHER.match(cut, PLAN).wall_surfaces}
    assert answer["left"] == answer["right"] == drawn.wall_surfaces[longest.id]


def test_walls_that_are_not_in_the_plan_stay_unmatched(drawn):
    room = drawn.s_graph.rooms[0]
    screen = WallSurface("screen", room.id, room.centroid, (math.cos(0.8), math.sin(0.8)), 2.0, "map")
    s = same_graph(drawn.s_graph, wall_surfaces=(*drawn.s_graph.wall_surfaces, screen))
    result = MATCHER.match(s, PLAN)
    assert result.status == "unique"
    assert "screen" not in {w for w, _, _ in result.wall_surfaces}


def test_hypotheses_are_distinct_sorted_and_the_answer_is_the_first(drawn):
    result = MATCHER.match(drawn.s_graph, merged(PLAN, a_graph(flat(np.random.default_rng(3)), "upper", "upper")))
    scores = [h.score for h in result.hypotheses]
    assert len(scores) > 2 and scores == sorted(scores, reverse=True)
    assert result.hypotheses[0].rooms == tuple((s, a) for s, a, _ in result.rooms)
    centre = drawn.s_graph.centroid()
    places = [(h.floor, se2.apply(np.array(h.T_a_s), centre), h.T_a_s[0]) for h in result.hypotheses]
    for n, (floor, at, yaw) in enumerate(places):
        for other_floor, other_at, other_yaw in places[:n]:
            apart = np.hypot(*(at - other_at)) > 0.45 or abs(math.remainder(yaw - other_yaw, math.tau)) > 0.08
            assert floor != other_floor or apart
    assert all(0 <= c <= 1 for _, _, c in (*result.rooms, *result.wall_surfaces))


@pytest.mark.parametrize("walls", [0, 1, 2, 3])
def test_next_to_nothing_seen_or_planned_is_no_match(walls):
    few = same_graph(PLAN, rooms=PLAN.rooms[:1], wall_surfaces=PLAN.wall_surfaces[:walls])
    for s, a in ((few, PLAN), (PLAN, few), (few, few)):
        result = MATCHER.match(s, a)
        assert result.status != "unique" and result.reason
        assert result.to_dict()["T_a_s"] is None or result.status == "ambiguous"


def test_two_parallel_walls_slide_along_each_other():
    walls = a_graph([box(0, 0, 20, 2)]).wall_surfaces
    corridor = SceneGraph("map", (), tuple(dataclasses.replace(w, room=None) for w in walls if w.length > 3))
    assert MATCHER.match(corridor, PLAN).status != "unique"


def test_an_unknown_method_is_named():
    with pytest.raises(UserError, match=r"no matching method 'magic'.*voting"):
        Matcher.load("magic")
