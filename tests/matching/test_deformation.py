"""Maps that bend: which pairs are found, which places are told apart, and by whose proposals."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from methods import VOTED, matcher
from plans import a_graph, box, flat, merged, moved, offices

from data import Door, SceneGraph, WallSurface
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import MatchResult
from matching.arrays import Walls
from matching.deformation import DeformableMatcher
from matching.search import Proposals
from matching.search.proposals import Proposer
from matching.search.voting_proposals import voting_proposals

MATCHER = matcher(VOTED)
PLAN = a_graph(flat(np.random.default_rng(3)), "ground")


def drawn_from(plan: SceneGraph, noise: str, seed: int, rooms: int | None = None) -> DrawnGraph:
    return draw(plan, noise, np.random.default_rng(seed), rooms)


@pytest.fixture(scope="module")
def drifted() -> DrawnGraph:
    return drawn_from(PLAN, "drift", 1, 9)


def pairs(result: MatchResult) -> set[tuple[str, str]]:
    return {(s, a) for s, a, _ in (*result.rooms, *result.wall_surfaces)}


def share_right(result: MatchResult, truth: DrawnGraph) -> float:
    return sum(truth.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces) / len(truth.wall_surfaces)


def test_a_drifting_map_is_matched_and_decided(drifted: DrawnGraph) -> None:
    result = MATCHER.match(drifted.s_graph, PLAN)
    assert result.status == "unique", result.reason
    assert {(s, a) for s, a, _ in result.rooms} <= set(drifted.rooms.items())
    assert len(result.rooms) >= 0.9 * len(drifted.rooms)
    assert share_right(result, drifted) > 0.9


def test_rooms_merged_and_cut_are_not_matched_wrongly() -> None:
    for seed in range(6):
        truth = drawn_from(PLAN, "mis_segmented", seed, 8)
        result = MATCHER.match(truth.s_graph, PLAN)
        assert {(s, a) for s, a, _ in result.rooms} <= set(truth.rooms.items()), seed
        assert share_right(result, truth) > 0.85


def test_doors_tell_equal_offices_apart() -> None:
    """Ten equal offices on both sides of a corridor; those below have their doors left or right."""
    row = a_graph(offices([3.0] * 5, [3.0] * 5))
    below, above, corridor = row.rooms[:5], row.rooms[5:10], row.rooms[10]
    places = [*zip(below, (-1.0, 1.0, -1.0, -1.0, 1.0), strict=True), *((r, -0.6) for r in above)]
    doors = tuple(
        Door(f"d{n}", (r.id, corridor.id), (r.centroid[0] + off, 5.06 if r in below else 7.18))
        for n, (r, off) in enumerate(places)
    )
    plan = dataclasses.replace(row, doors=doors)
    seen = {corridor.id, *(r.id for r in below[1:4])}
    part = SceneGraph(
        "map", tuple(r for r in plan.rooms if r.id in seen),
        tuple(
            dataclasses.replace(w, length=min(w.length or 0.0, 9.5), centroid=(7.7, w.centroid[1]))
            if w.room == corridor.id and abs(w.normal[1]) > 0.5 else w
            for w in plan.wall_surfaces if w.room in seen and (w.room != corridor.id or abs(w.normal[1]) > 0.5)
        ),
        tuple(d for d in plan.doors if set(d.rooms) <= seen),
    )  # fmt: skip
    bare = dataclasses.replace(part, doors=())
    assert MATCHER.match(moved(bare, 1.0, 2.0, 3.0), plan).status == "ambiguous"
    told = MATCHER.match(moved(part, 2.0, 5.0, -3.0), plan)
    assert told.status == "unique" and {(s, a) for s, a, _ in told.rooms} == {(r, r) for r in seen}


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_walls_that_end_elsewhere_tell_storeys_apart(seed: int) -> None:
    """Of the upper storey every third wall is 0.8 m shorter, at one end."""
    upper = a_graph(flat(np.random.default_rng(3)), "upper", "upper")
    walls = list(upper.wall_surfaces)
    for n, w in enumerate(walls):
        if n % 3 == 0 and w.length > 1.5:
            middle = (w.centroid[0] - 0.4 * w.normal[1], w.centroid[1] + 0.4 * w.normal[0])
            walls[n] = dataclasses.replace(w, length=w.length - 0.8, centroid=middle)
    tower = merged(PLAN, dataclasses.replace(upper, wall_surfaces=tuple(walls)))
    drawn = draw(tower, "real", np.random.default_rng(seed), 4, "ground")
    result = MATCHER.match(drawn.s_graph, tower)
    assert (result.status, result.floor) == ("unique", "ground")


@pytest.mark.parametrize(("length", "matched"), [(0.3, True), (1.3, False)])
def test_a_short_piece_may_slide_off_a_short_wall(length: float, matched: bool) -> None:
    """Where a wall's ends are seen to lie varies by 0.35 m: more than a pillar's side is long."""
    room = max(PLAN.rooms, key=lambda r: sum(w.length for w in PLAN.surfaces_of_room[r.id]))
    pillar = WallSurface("pillar", room.id, room.centroid, (1.0, 0.0), length, room.floor)
    x, y = room.centroid
    slid = dataclasses.replace(pillar, centroid=(x, y + length / 2 + 0.3), length=0.4)
    plan = dataclasses.replace(PLAN, wall_surfaces=(*PLAN.wall_surfaces, pillar))
    seen = dataclasses.replace(PLAN, wall_surfaces=(*PLAN.wall_surfaces, slid))
    assert (("pillar", "pillar") in pairs(MATCHER.match(seen, plan))) is matched


def test_of_equal_rooms_those_in_an_emptier_storey_are_no_likelier() -> None:
    """The upper storey lacks a wing that the lower one has; the rooms that were seen are on both."""
    wing = a_graph([box(40, 4 * k, 6, 3.85) for k in range(8)], "ground", "wing")
    site = merged(PLAN, wing, a_graph(flat(np.random.default_rng(3)), "upper", "upper"))
    for seed in range(3):
        result = MATCHER.match(drawn_from(PLAN, "drift", seed, 9).s_graph, site)
        first, second = result.hypotheses[:2]
        assert result.status == "ambiguous" and {first.floor, second.floor} == {"ground", "upper"}
        assert abs(first.score - second.score) < 0.5


def proposing(share: Callable[[str, str], float]) -> Proposer:
    """Proposes pairs of walls, by their ids, and none of rooms."""

    def propose(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        walls = np.array([[share(w.id, v.id) for v in a.wall_surfaces] for w in s.wall_surfaces], dtype=float)
        return Proposals.of_dense(walls, np.zeros((len(s.rooms), len(a.rooms))))

    return propose


@pytest.mark.parametrize("rooms", [2, 9])
@pytest.mark.parametrize("misled", [False, True])
def test_where_one_proposes_nothing_or_is_misled_the_others_are_asked(rooms: int, misled: bool) -> None:
    truth = drawn_from(PLAN, "real", 2, rooms)
    home = np.array(PLAN.room_by_id[next(iter(truth.rooms.values()))].centroid)
    far = max(PLAN.rooms, key=lambda r: np.hypot(*(np.array(r.centroid) - home)))
    proposer = proposing(lambda i, j: 0.5 if misled and PLAN.surface_by_id[j].room == far.id else 0.0)
    alone, helped = (DeformableMatcher(proposer, o).match(truth.s_graph, PLAN) for o in (None, voting_proposals))
    assert alone.status == "none" and share_right(alone, truth) < 0.2
    assert share_right(helped, truth) > 0.85


def test_a_symmetric_place_is_found_even_if_not_proposed(drifted: DrawnGraph) -> None:
    tower = merged(PLAN, a_graph(flat(np.random.default_rng(3)), "upper", "upper"))
    proposer = proposing(lambda i, j: float(drifted.wall_surfaces.get(i) == j))
    result = DeformableMatcher(proposer).match(drifted.s_graph, tower)
    assert result.status == "ambiguous" and {h.floor for h in result.hypotheses[:2]} == {"ground", "upper"}
    known = MATCHER.match(drifted.s_graph, tower, floor="ground")
    assert (known.status, known.floor) == ("unique", "ground")
    assert {a for _, a, _ in known.wall_surfaces} <= {w.id for w in PLAN.wall_surfaces}
