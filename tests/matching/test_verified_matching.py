"""How strong the methods are that verify their answers, on plans and maps whose truth is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from methods import VERIFYING, matcher
from plans import a_graph, flat, merged, moved, offices

from data import SceneGraph, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import MatchResult

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
OTHER = a_graph(flat(np.random.default_rng(4)), "ground", "other")
DRAWN = draw(PLAN, "real", np.random.default_rng(1), 5)


# of the judge: where the plan has another building, it may be less sure than the evidence
CAUTIOUS = ("test_a_building_far_away_changes_nothing",)


@pytest.fixture(params=VERIFYING)
def method(request: pytest.FixtureRequest) -> str:
    if request.param == "learned" and request.node.originalname in CAUTIOUS:
        request.applymarker(pytest.mark.xfail(reason="the judge is not sure of the right place", strict=False))
    return str(request.param)


def misplaced(result: MatchResult, truth: DrawnGraph) -> tuple[float, float]:
    """Metres at the S-graph's centroid, radians."""
    T_a_s, centre = np.array(result.hypotheses[0].T_a_s), truth.s_graph.centroid()
    off = math.hypot(*(se2.apply(T_a_s, centre) - se2.apply(np.array(truth.T_a_s), centre)))
    return off, abs(math.remainder(T_a_s[0] - truth.T_a_s[0], math.tau))


def share_right(result: MatchResult, truth: DrawnGraph) -> float:
    return sum(truth.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces) / len(truth.wall_surfaces)


def edited(graph: SceneGraph, **changes: object) -> SceneGraph:
    """The graph with all of its walls changed; without rooms, if they lose theirs."""
    walls = tuple(replace(w, **changes) for w in graph.wall_surfaces)  # type: ignore[arg-type]
    return replace(graph, wall_surfaces=walls, **({"rooms": (), "doors": ()} if "room" in changes else {}))


@pytest.mark.parametrize(("noise", "limit_m", "limit_deg"), [("real", 0.2, 2), ("drift", 0.6, 5)])
def test_finds_the_place_of_a_map_with_the_noise_of_real_scans(
    method: str, noise: str, limit_m: float, limit_deg: float
) -> None:
    for seed in range(4):
        truth = draw(PLAN, noise, np.random.default_rng(seed), 6)
        result = matcher(method).match(truth.s_graph, PLAN)
        off, turned = misplaced(result, truth)
        assert result.status == "unique", result.reason
        assert off < limit_m and turned < math.radians(limit_deg)
        assert {(s, a) for s, a, _ in result.rooms} == set(truth.rooms.items())
        assert share_right(result, truth) > 0.85


@pytest.mark.parametrize("plan", [OTHER, moved(PLAN, 0.4, 5.0, 1.0, mirror=True)], ids=["other", "mirrored"])
def test_another_building_is_never_unique(method: str, plan: SceneGraph) -> None:
    for seed in range(5):  # of the mirrored one so many rooms that they are no mirror image of themselves
        truth = draw(PLAN, "real", np.random.default_rng(seed), (3 if plan is OTHER else 9) + seed % 4)
        assert matcher(method).match(truth.s_graph, plan).status != "unique"


@pytest.mark.parametrize("at", [(700.0, -400.0), (80_000.0, -20_000.0)])
def test_a_building_far_away_changes_nothing(method: str, at: tuple[float, float]) -> None:
    alone = matcher(method).match(DRAWN.s_graph, PLAN)
    beside = matcher(method).match(DRAWN.s_graph, merged(moved(OTHER, 0.3, *at), PLAN))
    assert (beside.status, beside.floor) == (alone.status, alone.floor)
    for one, other in ((alone.rooms, beside.rooms), (alone.wall_surfaces, beside.wall_surfaces)):
        assert {pair[:2] for pair in one} == {pair[:2] for pair in other}
    assert beside.T_a_s == pytest.approx(alone.T_a_s, abs=1e-3)
    assert beside.hypotheses[0].score == pytest.approx(alone.hypotheses[0].score, abs=0.5)


def test_finds_the_storey_and_equal_storeys_are_ambiguous_until_it_is_known(method: str) -> None:
    upper, equal = (a_graph(flat(np.random.default_rng(k)), "upper", "upper") for k in (4, 3))
    for seed in range(3):
        truth = draw(upper, "real", np.random.default_rng(seed), 5)
        result = matcher(method).match(truth.s_graph, merged(PLAN, upper))
        assert (result.status, result.floor) == ("unique", "upper")
    result = matcher(method).match(DRAWN.s_graph, merged(PLAN, equal))
    assert result.status == "ambiguous" and "2 storeys" in result.reason
    assert {h.floor for h in result.hypotheses[:2]} == {"ground", "upper"}
    known = matcher(method).match(DRAWN.s_graph, merged(PLAN, equal), floor="upper")
    assert (known.status, known.floor) == ("unique", "upper")
    assert all(a.startswith("upper") for _, a, _ in known.rooms)


def test_a_rough_start_decides_between_equal_places(method: str) -> None:
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    truth = draw(row, "real", np.random.default_rng(2), 4)
    assert matcher(method).match(truth.s_graph, row).status == "ambiguous"
    yaw, x, y = truth.T_a_s
    result = matcher(method).match(truth.s_graph, row, start=(yaw + 0.3, x + 0.7, y - 0.5))
    assert result.status == "unique" and misplaced(result, truth)[0] < 0.3
    assert matcher(method).match(truth.s_graph, row, start=(yaw, x + 500, y)).status == "none"


@pytest.mark.parametrize("of", ["map", "plan", "both"])
def test_walls_without_rooms_or_without_lengths_are_enough(method: str, of: str) -> None:
    for changes, least in (({"room": None}, 0.8), ({"length": None}, 0.7)):
        s = DRAWN.s_graph if of == "plan" else edited(DRAWN.s_graph, **changes)
        a = PLAN if of == "map" else edited(PLAN, **changes)
        result = matcher(method).match(s, a)
        assert misplaced(result, DRAWN)[0] < 0.3 and share_right(result, DRAWN) > least
        assert (result.status == "unique" and result.rooms == ()) or (result.status != "none" and "length" in changes)


def test_pieces_match_the_whole_wall_and_what_is_not_in_the_plan_stays_unmatched(method: str) -> None:
    s = DRAWN.s_graph
    longest = max((w for w in s.wall_surfaces if w.id in DRAWN.wall_surfaces), key=lambda w: w.length or 0.0)
    ends, length = np.array(longest.ends()), 0.4 * (longest.length or 0.0)
    x, y = ((1 - t) * ends[0] + t * ends[1] for t in (0.2, 0.8))
    left, right = (
        replace(longest, id=name, centroid=tuple(at.tolist()), length=length) for name, at in (("l", x), ("r", y))
    )
    room = s.rooms[0]
    screen = WallSurface("screen", room.id, room.centroid, (math.cos(0.8), math.sin(0.8)), 2.0, "map")
    others = tuple(w for w in s.wall_surfaces if w is not longest)
    result = matcher(method).match(replace(s, wall_surfaces=(*others, left, right, screen)), PLAN)
    answer = {i: j for i, j, _ in result.wall_surfaces}
    assert result.status == "unique" and "screen" not in answer
    assert answer["l"] == answer["r"] == DRAWN.wall_surfaces[longest.id]
