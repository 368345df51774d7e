"""What every matching method promises: the form of its answers, and that it is never sure of a wrong place."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from methods import CHIRAL, METHODS, SMALL, VERIFYING, as_map, matcher
from plans import a_graph, flat, merged, moved

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.noise_models import draw
from matching import MatchResult

UNVERIFIED = {"paper": "it calls every assignment unique and verifies none"}
# Known breaches by test and method. A method that comes to keep the contract fails here until its breach is struck off.
BREACHES: dict[str, dict[str, str]] = {
    "test_the_frames_may_lie_anywhere": {"paper": "it compares coordinates and directions of both frames"},
    "test_order_and_names_of_nodes_tell_nothing": {"paper": "its edges follow the order of a room's walls"},
    "test_next_to_nothing_seen_or_planned_is_not_unique": UNVERIFIED | {
        "combinatorial": "one room that agrees is enough for it"
    },
    "test_a_mirrored_map_is_not_unique": UNVERIFIED | {"combinatorial": "distances and angles do not show a mirror"},
    "test_another_building_is_not_unique": UNVERIFIED,
    "test_equal_storeys_are_not_unique": UNVERIFIED,
    "test_a_unique_answer_is_right": UNVERIFIED,
}  # fmt: skip
CHIRAL_PLAN = a_graph(CHIRAL, "ground")
ROOM_PAIR = a_graph(CHIRAL[:2], "ground")
MAPS = {
    "whole": (moved(as_map(SMALL), 0.02, 0.1, 0.1), SMALL),
    "noisy": (draw(SMALL, "real", np.random.default_rng(1), 4).s_graph, SMALL),
    "drifting": (draw(SMALL, "drift", np.random.default_rng(1), 5).s_graph, SMALL),
    "another building's": (as_map(a_graph(CHIRAL)), SMALL),
    "of equal storeys": (as_map(ROOM_PAIR), merged(ROOM_PAIR, a_graph(CHIRAL[:2], "upper", "upper"))),
    "empty": (SceneGraph("map"), SMALL),
}
IN_PLAN = [MAPS[of] for of in ("whole", "noisy", "drifting")]


@pytest.fixture(params=METHODS)
def method(request: pytest.FixtureRequest) -> str:
    reason = BREACHES.get(request.node.originalname, {}).get(request.param)
    if reason is not None:
        request.applymarker(pytest.mark.xfail(reason=reason, strict=True))
    return str(request.param)


def paired(result: MatchResult) -> set[tuple[str, str]]:
    return {(s, a) for s, a, _ in (*result.rooms, *result.wall_surfaces)}


def test_the_released_search_matches_walls_without_a_room_by_their_place() -> None:
    inner = SMALL.rooms[0].id
    walls = tuple(replace(w, room=None) if w.room == inner else w for w in SMALL.wall_surfaces)
    plan = replace(SMALL, rooms=SMALL.rooms[1:], doors=(), wall_surfaces=walls)
    seen = as_map(plan)
    found = {s: a for s, a, _ in matcher("combinatorial").match(seen, plan).wall_surfaces}
    roomless = {s.id: a.id for s, a in zip(seen.wall_surfaces, walls, strict=True) if a.room is None}
    assert len(roomless) > 3 and {s: found.get(s) for s in roomless} == roomless


@pytest.mark.parametrize("of", MAPS)
def test_an_answer_has_the_form_of_matches_json_and_is_its_first_hypothesis(method: str, of: str) -> None:
    s, a = MAPS[of]
    result = matcher(method).match(s, a)
    value = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert value == result.to_dict()
    names = ["status", "reason", "rooms", "wall_surfaces", "T_a_s", "floor", "hypotheses", "seconds", "temperature"]
    assert list(value) == names and value["temperature"] > 0
    assert value["status"] in ("unique", "ambiguous", "none") and value["seconds"] >= 0
    assert value["reason"] and "\n" not in value["reason"]
    assert (value["T_a_s"] is None) == (value["status"] == "none")
    assert value["floor"] in {None, *(r.floor for r in a.rooms)}
    for pairs, in_s, in_a in (("rooms", s.room_by_id, a.room_by_id),
                              ("wall_surfaces", s.surface_by_id, a.surface_by_id)):  # fmt: skip
        assert all(i in in_s and j in in_a and 0 <= c <= 1 for i, j, c in value[pairs])
        assert len({i for i, _, _ in value[pairs]}) == len(value[pairs])
    scores = [h.score for h in result.hypotheses]
    known = [h.probability for h in result.hypotheses if h.probability is not None]
    assert all(p >= 0 for p in known) and sum(known) <= 1 + 1e-9 and len(known) == (method in VERIFYING) * len(scores)
    order = known if method == "learned" else scores
    assert order == sorted(order, reverse=True) and (scores or result.status == "none")
    if scores:
        first = result.hypotheses[0]
        assert first.floor == result.floor and result.T_a_s in (None, first.T_a_s)
        assert first.rooms == tuple((i, j) for i, j, _ in result.rooms)


@pytest.mark.parametrize("of", MAPS)
def test_the_same_graphs_have_the_same_answer_whatever_was_asked_before(method: str, of: str) -> None:
    new, used = matcher.__wrapped__(method), matcher(method)
    assert new.match(*MAPS[of]) == used.match(*MAPS[of]) == used.match(*MAPS[of])


def test_the_motion_takes_the_map_to_the_plan(method: str) -> None:
    T_s_a = np.array([0.02, 0.1, 0.1])
    result = matcher(method).match(*MAPS["whole"])
    assert result.status == "unique" and result.floor == "ground"
    assert result.T_a_s == pytest.approx(se2.inverse(T_s_a).tolist(), abs=0.01)
    own = {(n.id, n.id) for n in (*SMALL.rooms, *SMALL.wall_surfaces)}
    assert len(paired(result) ^ own) <= 0.2 * len(own)  # `paper` swaps two rooms on some processors: 4 of 30


def off(before: MatchResult, after: MatchResult, T_s: se2.Array, T_a: se2.Array) -> float:
    """By how much (m, rad, nats) two answers differ that should be the same but for motions of map and plan."""
    if after.status != before.status or after.floor != before.floor or paired(after) != paired(before):
        return math.inf
    if before.T_a_s is None or after.T_a_s is None:
        return 0.0
    expected = se2.compose(se2.compose(T_a, np.array(before.T_a_s)), se2.inverse(T_s))
    yaw, *metres = se2.compose(se2.inverse(expected), np.array(after.T_a_s)).tolist()
    worth = after.hypotheses[0].score - before.hypotheses[0].score
    return max(math.hypot(*metres), 10 * abs(math.remainder(yaw, math.tau)), 0.05 * abs(worth))


@pytest.mark.parametrize("of", ["map", "plan"])
def test_the_frames_may_lie_anywhere(method: str, of: str) -> None:
    T, still = np.array([2.3, 310.0, -45.0]), np.zeros(3)
    T_s, T_a = (T, still) if of == "map" else (still, T)
    for s, a in IN_PLAN:
        before, after = matcher(method).match(s, a), matcher(method).match(moved(s, *T_s), moved(a, *T_a))
        assert off(before, after, T_s, T_a) < 0.02


def renamed(graph: SceneGraph, letter: str) -> tuple[SceneGraph, dict[str, str]]:
    """The graph with other ids in another order, and the former ids by the new ones."""
    rng = np.random.default_rng(0)
    rooms = [graph.rooms[k] for k in rng.permutation(len(graph.rooms))]
    walls = [graph.wall_surfaces[k] for k in rng.permutation(len(graph.wall_surfaces))]
    new = {n.id: f"{letter}{k}" for k, n in enumerate((*rooms, *walls))}
    other = replace(
        graph, rooms=tuple(replace(r, id=new[r.id]) for r in rooms),
        wall_surfaces=tuple(replace(w, id=new[w.id], room=w.room and new[w.room]) for w in walls),
        doors=tuple(replace(d, rooms=tuple(new[r] for r in d.rooms)) for d in graph.doors),
    )  # fmt: skip
    return other, {v: k for k, v in new.items()}


def test_order_and_names_of_nodes_tell_nothing(method: str) -> None:
    for graphs in IN_PLAN:
        (s, of_s), (a, of_a) = (renamed(graph, letter) for graph, letter in zip(graphs, "xy", strict=True))
        after = matcher(method).match(s, a)
        rooms, walls = (
            tuple((of_s[i], of_a[j], c) for i, j, c in pairs) for pairs in (after.rooms, after.wall_surfaces)
        )
        after = replace(after, rooms=rooms, wall_surfaces=walls)
        assert off(matcher(method).match(*graphs), after, np.zeros(3), np.zeros(3)) < 0.02


def test_a_graph_without_walls_is_no_match(method: str) -> None:
    bare = replace(SMALL, wall_surfaces=())
    for s, a in ((SceneGraph("map"), SMALL), (as_map(SMALL), SceneGraph("bim")), (SceneGraph("map"), SceneGraph("bim")),
                 (as_map(bare), SMALL), (as_map(SMALL), bare)):  # fmt: skip
        result = matcher(method).match(s, a)
        assert (result.status, result.T_a_s, result.wall_surfaces, result.hypotheses) == ("none", None, (), ())


def test_next_to_nothing_seen_or_planned_is_not_unique(method: str) -> None:
    for walls in (1, 2, 3):
        few = replace(SMALL, rooms=SMALL.rooms[:1], wall_surfaces=SMALL.wall_surfaces[:walls])
        for s, a in ((few, SMALL), (SMALL, few), (few, few)):
            assert matcher(method).match(as_map(s), a).status != "unique"


def test_a_mirrored_map_is_not_unique(method: str) -> None:
    assert matcher(method).match(moved(as_map(CHIRAL_PLAN), 0.4, 5.0, 1.0, mirror=True), CHIRAL_PLAN).status != "unique"


def test_another_building_is_not_unique(method: str) -> None:
    for s in (as_map(CHIRAL_PLAN), *(as_map(a_graph(flat(np.random.default_rng(k), 11, 8))) for k in (6, 7))):
        assert matcher(method).match(s, SMALL).status != "unique"


def test_equal_storeys_are_not_unique(method: str) -> None:
    assert matcher(method).match(*MAPS["of equal storeys"]).status != "unique"


@pytest.mark.parametrize("noise", ["real", "drift", "mis_segmented"])
def test_a_unique_answer_is_right(method: str, noise: str) -> None:
    for seed in range(8):
        drawn = draw(SMALL, noise, np.random.default_rng(seed), 2 + seed % 5)
        result = matcher(method).match(drawn.s_graph, SMALL)
        if result.status == "unique":
            assert result.floor == drawn.floor and {(i, j) for i, j, _ in result.rooms} <= {*drawn.rooms.items()}
            there, true = (se2.apply(np.array(T), drawn.s_graph.centroid()) for T in (result.T_a_s, drawn.T_a_s))
            assert math.hypot(*(there - true)) < (1.0 if drawn.deformed else 0.5)
