"""How strong the methods are that verify their answers, on plans and maps whose truth is known."""

import dataclasses
import math

import numpy as np
import pytest
from methods import VERIFYING, matcher
from plans import a_graph, flat, merged, moved, offices

from data import SceneGraph, UserError, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher, MatchResult
from matching.arrays import storeys

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
OTHER = a_graph(flat(np.random.default_rng(4)), "ground", "other")
FAR = moved(a_graph(flat(np.random.default_rng(6)), "ground", "far/"), 0.3, 700.0, -400.0)


@pytest.fixture(params=VERIFYING)
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


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
def test_finds_the_place_of_a_map_with_the_noise_of_real_scans(method, noise, limit_m, limit_deg):
    for seed in range(6):
        truth = draw(PLAN, noise, np.random.default_rng(seed), 6)
        result = matcher(method).match(truth.s_graph, PLAN)
        off, turned = misplaced(result, truth)
        assert result.status == "unique", result.reason
        assert off < limit_m and turned < math.radians(limit_deg)
        assert {(s, a) for s, a, _ in result.rooms} == set(truth.rooms.items())
        assert share_right(result, truth) > 0.85


@pytest.mark.parametrize("plan", [OTHER, moved(PLAN, 0.4, 5.0, 1.0, mirror=True)], ids=["other", "mirrored"])
def test_another_building_is_never_unique(method, plan):
    for seed in range(8):  # of the mirrored one so many rooms that they are no mirror image of themselves
        truth = draw(PLAN, "real", np.random.default_rng(seed), (3 if plan is OTHER else 9) + seed % 4)
        assert matcher(method).match(truth.s_graph, plan).status != "unique"


@pytest.mark.parametrize("at", [(700.0, -400.0), (80_000.0, -20_000.0)])
def test_a_building_far_away_changes_nothing(method, drawn, at):
    alone = matcher(method).match(drawn.s_graph, PLAN)
    beside = matcher(method).match(drawn.s_graph, merged(moved(OTHER, 0.3, *at), PLAN))
    assert (beside.status, beside.floor, pairs(beside)) == (alone.status, alone.floor, pairs(alone))
    assert beside.T_a_s == pytest.approx(alone.T_a_s, abs=1e-3)
    assert beside.hypotheses[0].score == pytest.approx(alone.hypotheses[0].score, abs=0.5)


def test_land_that_is_not_built_on_does_not_count():
    (one,), (other,), (site,) = (storeys(g) for g in (PLAN, FAR, merged(FAR, PLAN)))
    assert site.area == pytest.approx(one.area + other.area, rel=1e-6)
    assert len(site.building_areas) == 2 and len(one.building_areas) == 1
    hall = a_graph([[(0, 0), (90, 0), (90, 60), (0, 60)]])
    assert storeys(hall)[0].area == pytest.approx(91 * 61)


def test_finds_the_storey(method):
    upper = a_graph(flat(np.random.default_rng(4)), "upper", "upper")
    for seed in range(4):
        truth = draw(upper, "real", np.random.default_rng(seed), 5)
        result = matcher(method).match(truth.s_graph, merged(PLAN, upper))
        assert (result.status, result.floor) == ("unique", "upper")


def test_equal_storeys_are_ambiguous_until_the_storey_is_known(method, drawn):
    symmetry = a_graph(flat(np.random.default_rng(3)), "upper", "upper")
    tower = merged(PLAN, symmetry)
    result = matcher(method).match(drawn.s_graph, tower)
    assert result.status == "ambiguous"
    assert "2 storeys" in result.reason
    assert {h.floor for h in result.hypotheses[:2]} == {"ground", "upper"}
    known = matcher(method).match(drawn.s_graph, tower, floor="upper")
    assert (known.status, known.floor) == ("unique", "upper")
    assert all(a.startswith("upper") for _, a, _ in known.rooms)


def test_a_rough_start_decides_between_equal_places(method):
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    truth = draw(row, "real", np.random.default_rng(2), 4)
    assert matcher(method).match(truth.s_graph, row).status == "ambiguous"
    yaw, x, y = truth.T_a_s
    result = matcher(method).match(truth.s_graph, row, start=(yaw + 0.3, x + 0.7, y - 0.5))
    assert result.status == "unique" and misplaced(result, truth)[0] < 0.3
    assert matcher(method).match(truth.s_graph, row, start=(yaw, x + 500, y)).status == "none"


def test_one_room_is_not_enough(method):
    room = draw(PLAN, "real", np.random.default_rng(0), 1).s_graph
    result = matcher(method).match(room, PLAN)
    assert result.status != "unique"
    assert result.reason


def test_walls_without_rooms_are_enough(method, drawn):
    def bare(graph):
        walls = tuple(dataclasses.replace(w, room=None) for w in graph.wall_surfaces)
        return same_graph(graph, rooms=(), doors=(), wall_surfaces=walls)

    for s, a in ((bare(drawn.s_graph), PLAN), (drawn.s_graph, bare(PLAN)), (bare(drawn.s_graph), bare(PLAN))):
        result = matcher(method).match(s, a)
        assert result.status == "unique" and result.rooms == ()
        assert misplaced(result, drawn)[0] < 0.2
        assert share_right(result, drawn) > 0.8


@pytest.mark.parametrize("of", ["map", "plan", "both"])
def test_lengths_may_be_unknown(method, drawn, of):
    def unmeasured(graph):
        walls = tuple(dataclasses.replace(w, length=None) for w in graph.wall_surfaces)
        return same_graph(graph, wall_surfaces=walls)

    s = drawn.s_graph if of == "plan" else unmeasured(drawn.s_graph)
    a = PLAN if of == "map" else unmeasured(PLAN)
    result = matcher(method).match(s, a)
    assert misplaced(result, drawn)[0] < 0.3
    assert share_right(result, drawn) > 0.7
    assert result.status != "none"


def test_a_wall_seen_in_pieces_matches_one_wall_of_the_plan(method, drawn):
    longest = max((w for w in drawn.s_graph.wall_surfaces if w.id in drawn.wall_surfaces), key=lambda w: w.length)
    (x0, y0), (x1, y1) = longest.ends()

    def piece(name, at):
        centre = (x0 + at * (x1 - x0), y0 + at * (y1 - y0))
        return dataclasses.replace(longest, id=name, centroid=centre, length=0.4 * longest.length)

    others = tuple(w for w in drawn.s_graph.wall_surfaces if w is not longest)
    cut = same_graph(drawn.s_graph, wall_surfaces=(*others, piece("left", 0.2), piece("right", 0.8)))
    answer = {s: a for s, a, _ in matcher(method).match(cut, PLAN).wall_surfaces}
    assert answer["left"] == answer["right"] == drawn.wall_surfaces[longest.id]


def test_walls_that_are_not_in_the_plan_stay_unmatched(method, drawn):
    room = drawn.s_graph.rooms[0]
    screen = WallSurface("screen", room.id, room.centroid, (math.cos(0.8), math.sin(0.8)), 2.0, "map")
    s = same_graph(drawn.s_graph, wall_surfaces=(*drawn.s_graph.wall_surfaces, screen))
    result = matcher(method).match(s, PLAN)
    assert result.status == "unique"
    assert "screen" not in {w for w, _, _ in result.wall_surfaces}


def test_an_unknown_method_is_named():
    with pytest.raises(UserError, match=r"no matching method 'magic'.*voting"):
        Matcher.load("magic")
