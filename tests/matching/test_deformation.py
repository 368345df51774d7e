"""Maps that bend, laid into plans by proposals, a field of motions and what verifies it."""

import dataclasses

import numpy as np
import pytest
from methods import VOTED, matcher
from plans import a_graph, box, flat, merged, moved, offices

from data import Door, SceneGraph, UserError, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import MatchResult
from matching.arrays import PlanCache, Walls, storeys
from matching.arrays.blocks import elimination, solve
from matching.arrays.cache import PLANS_CACHED
from matching.deformation import DeformableMatcher
from matching.deformation import deformed_hypotheses as bent
from matching.deformation.field import motions
from matching.deformation.matcher import FEW, among, together
from matching.search import Proposals, TopK
from matching.search.corners import corners
from matching.search.hypotheses import between_graphs
from matching.search.plan_walls import PlanWalls
from matching.search.proposals import Proposer
from matching.search.voting import marks
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


def found_for(truth: DrawnGraph, plan: SceneGraph) -> bent.DeformedHypotheses:
    s, walls = truth.s_graph, PlanWalls.of(plan)
    assert walls is not None
    return bent.search(bent.scene_of(s, walls), among(voting_proposals(s, plan).walls, walls))


def errors_by_room(found: bent.DeformedHypotheses, truth: DrawnGraph) -> tuple[np.ndarray, np.ndarray]:
    """Metres at the rooms' centroids, of the best field and of the best rigid motion."""
    s, home = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[0])]
    own = motions(found.scene, found.fields.state)[0, found.scene.groups.of_wall]
    errors = []
    for r, room in enumerate(s.rooms):
        centre, true = np.array(room.centroid), np.array(truth.T_a_s_by_room[room.id])
        mine = between_graphs(s, home, own[np.flatnonzero(s.room == r)[0]])
        at = [se2.apply(T, centre) for T in (true, mine, np.array(truth.T_a_s))]
        errors.append([np.hypot(*(at[1] - at[0])), np.hypot(*(at[2] - at[0]))])
    return tuple(np.array(errors).T)


@pytest.mark.slow
def test_every_room_of_a_drifting_map_finds_its_own_motion():
    plan = a_graph(flat(np.random.default_rng(5), 30, 20), "ground")
    truth = drawn_from(plan, "drift", 4)
    field_error, rigid_error = errors_by_room(found_for(truth, plan), truth)
    assert len(field_error) > 40
    assert np.median(field_error) < 0.1 and np.quantile(field_error, 0.9) < 0.35
    assert np.median(field_error) < 0.4 * np.median(rigid_error)


@pytest.mark.slow
def test_a_drifting_map_is_matched_and_decided(drifted):
    result = MATCHER.match(drifted.s_graph, PLAN)
    assert result.status == "unique", result.reason
    assert {(s, a) for s, a, _ in result.rooms} <= set(drifted.rooms.items())
    assert len(result.rooms) >= 0.9 * len(drifted.rooms)
    assert share_right(result, drifted) > 0.9


def test_rooms_merged_and_cut_are_not_matched_wrongly():
    for seed in range(6):
        truth = drawn_from(PLAN, "mis_segmented", seed, 8)
        result = MATCHER.match(truth.s_graph, PLAN)
        assert {(s, a) for s, a, _ in result.rooms} <= set(truth.rooms.items()), seed
        assert share_right(result, truth) > 0.85


STAR, RING = [(0, k) for k in range(1, 9)], [(k, (k + 1) % 9) for k in range(9)]


@pytest.mark.parametrize("edges", [[(0, 1), (1, 2), (0, 4), (3, 4), (2, 5)], STAR, RING, []])
def test_systems_of_blocks_are_solved(edges):
    rng, count = np.random.default_rng(0), 9
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    order = elimination(ends, count)
    own, between = rng.normal(size=(count, 3, 3)), np.zeros((len(order.later), 3, 3))
    right = rng.normal(size=(count, 3))
    own = own @ np.swapaxes(own, -1, -2) + 40 * np.eye(3)
    whole, x = np.zeros((count, 3, count, 3)), right.copy()
    whole[range(count), :, range(count)] = own
    for (g, h), block, turned in zip(edges, order.of_edge, order.turned, strict=True):
        row, column = (h, g) if turned else (g, h)
        whole[row, :, column] = between[block] = rng.normal(size=(3, 3))
        whole[column, :, row] = between[block].T
    solve(order, own, between, x)
    np.testing.assert_allclose(np.tensordot(whole, x, 2), right, atol=1e-9)


def test_the_cache_of_a_plan_is_used_for_it_alone():
    worked = []
    kept = PlanCache(lambda graph: worked.append(graph.frame) or graph.frame)
    graphs = [SceneGraph(f"g{k}") for k in range(PLANS_CACHED + 1)]
    assert [kept(g) for g in graphs] == [g.frame for g in graphs]
    assert kept(graphs[-1]) == graphs[-1].frame and len(worked) == len(graphs)
    assert kept(graphs[0]) == "g0" and worked[-1] == "g0"


def test_doors_tell_equal_offices_apart():
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


def test_a_symmetric_place_is_found_even_if_not_proposed(drifted):
    tower = merged(PLAN, a_graph(flat(np.random.default_rng(3)), "upper", "upper"))
    ground = {w.id for w in PLAN.wall_surfaces}

    def only_ground(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        row = {w.id: n for n, w in enumerate(s.wall_surfaces)}
        walls = np.zeros((len(s.wall_surfaces), len(a.wall_surfaces)))
        for i, j in drifted.wall_surfaces.items():
            walls[row[i], [w.id for w in a.wall_surfaces].index(j)] = 1.0
        return Proposals.of_dense(walls, np.zeros((len(s.rooms), len(a.rooms))))

    result = DeformableMatcher(only_ground).match(drifted.s_graph, tower)
    assert result.status == "ambiguous" and "2 storeys" in result.reason
    assert {h.floor for h in result.hypotheses[:2]} == {"ground", "upper"}
    known = MATCHER.match(drifted.s_graph, tower, floor="ground")
    assert (known.status, known.floor) == ("unique", "ground")
    assert {a for _, a, _ in known.wall_surfaces} <= ground


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_walls_that_end_elsewhere_tell_storeys_apart(seed):
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


@pytest.mark.slow
def test_a_wall_is_matched_whole_beside_a_better_seen_piece_of_it():
    plan_wall = max(PLAN.wall_surfaces, key=lambda w: w.length)
    along = np.array([-plan_wall.normal[1], plan_wall.normal[0]])

    def piece(name, at, length, turned=0.0):
        yaw = np.arctan2(plan_wall.normal[1], plan_wall.normal[0]) + turned
        centre = plan_wall.centroid + at * along
        return dataclasses.replace(
            plan_wall, id=name, centroid=tuple(centre), normal=(np.cos(yaw), np.sin(yaw)), length=length, room=None,
        )  # fmt: skip

    seen = [piece("short", -0.4, 0.4), piece("long", 0.0, 1.3, np.radians(6))]
    others = tuple(w for w in PLAN.wall_surfaces if w is not plan_wall)
    result = MATCHER.match(dataclasses.replace(PLAN, wall_surfaces=(*others, *seen)), PLAN)
    matched = {s: a for s, a, _ in result.wall_surfaces}
    assert matched["short"] == matched["long"] == plan_wall.id


@pytest.mark.parametrize(("length", "matched"), [(0.3, True), (1.3, False)])
def test_a_short_piece_may_slide_off_a_short_wall(length, matched):
    """Where a wall's ends are seen to lie varies by 0.35 m: more than a pillar's side is long."""
    room = max(PLAN.rooms, key=lambda r: sum(w.length for w in PLAN.surfaces_of_room[r.id]))
    pillar = WallSurface("pillar", room.id, room.centroid, (1.0, 0.0), length, room.floor)
    x, y = room.centroid
    slid = dataclasses.replace(pillar, centroid=(x, y + length / 2 + 0.3), length=0.4)
    plan = dataclasses.replace(PLAN, wall_surfaces=(*PLAN.wall_surfaces, pillar))
    seen = dataclasses.replace(PLAN, wall_surfaces=(*PLAN.wall_surfaces, slid))
    assert (("pillar", "pillar") in pairs(MATCHER.match(seen, plan))) is matched


def test_nothing_proposed_is_no_match(drifted):
    nothing = DeformableMatcher(lambda s, a, _: Proposals.of_dense(
        np.zeros((len(s.wall_surfaces), len(a.wall_surfaces))), np.zeros((len(s.rooms), len(a.rooms)))
    ))  # fmt: skip
    assert nothing.match(drifted.s_graph, PLAN).status == "none"


def test_the_best_proposals_are_kept_in_order():
    dense = np.array([[0.1, 0.0, 0.7, 0.2], [0.0, 0.0, 0.0, 0.0]])
    top = TopK.of_dense(dense, 2)
    assert top.partner.tolist() == [[2, 3], [-1, -1]] and top.score[0].tolist() == [0.7, 0.2]
    with pytest.raises(UserError, match="probabilities"):
        TopK.of_dense(np.array([[1.2]]))


@pytest.mark.parametrize("stray", ["none", "some", "all"])
def test_corners_are_those_that_vote(stray):
    walls = storeys(PLAN)[0]
    gone = {"none": 0, "some": 2, "all": 1}[stray]
    room = walls.room if not gone else np.where(np.arange(len(walls)) % gone == 0, -1, walls.room)
    walls = dataclasses.replace(walls, room=room)

    def listed(found):
        return sorted(map(tuple, np.column_stack((found.point, found.heading, found.opening, found.kind)).round(6)))

    assert listed(corners(walls)) == listed(marks(walls))


def test_of_equal_rooms_those_in_an_emptier_storey_are_no_likelier():
    """The upper storey lacks a wing that the lower one has; the rooms that were seen are on both."""
    wing = a_graph([box(40, 4 * k, 6, 3.85) for k in range(8)], "ground", "wing")
    site = merged(PLAN, wing, a_graph(flat(np.random.default_rng(3)), "upper", "upper"))
    for seed in range(3):
        result = MATCHER.match(drawn_from(PLAN, "drift", seed, 9).s_graph, site)
        first, second = result.hypotheses[:2]
        assert result.status == "ambiguous" and {first.floor, second.floor} == {"ground", "upper"}
        assert abs(first.score - second.score) < 0.5


def test_a_pair_that_two_sources_propose_counts_once() -> None:
    one = TopK(np.array([[2, 5], [4, -1]]), np.array([[0.6, 0.3], [0.9, 0.0]]))
    other = TopK(np.array([[5, 7, -1], [4, 1, 3]]), np.array([[0.5, 0.2, 0.0], [0.2, 0.1, 0.05]]))
    both = together(one, other)
    for row, expected in enumerate(({2: 0.6, 5: 0.5, 7: 0.2}, {4: 0.9, 1: 0.1, 3: 0.05})):
        is_pair = both.partner[row] >= 0
        pairs = list(zip(both.partner[row][is_pair].tolist(), both.score[row][is_pair].tolist(), strict=True))
        assert len(pairs) == len(expected) and dict(pairs) == expected and not both.score[row][~is_pair].any()


def test_where_one_proposes_nothing_the_others_are_asked(drifted):
    def silent(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        return Proposals.of_dense(
            np.zeros((len(s.wall_surfaces), len(a.wall_surfaces))), np.zeros((len(s.rooms), len(a.rooms)))
        )

    assert DeformableMatcher(silent).match(drifted.s_graph, PLAN).status == "none"
    result = DeformableMatcher(silent, voting_proposals).match(drifted.s_graph, PLAN)
    assert result.status == "unique" and share_right(result, drifted) > 0.85


def misled_by(truth: DrawnGraph) -> Proposer:
    """Lays all walls on those of the room that is furthest from the first one."""

    def propose(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        home = next(iter(truth.rooms.values()))
        there = np.array(a.room_by_id[home].centroid)
        far = max(a.rooms, key=lambda r: np.hypot(*(np.array(r.centroid) - there)))
        walls = np.zeros((len(s.wall_surfaces), len(a.wall_surfaces)))
        for j, w in enumerate(a.wall_surfaces):
            walls[:, j] = 0.5 if w.room == far.id else 0.0
        return Proposals.of_dense(walls, np.zeros((len(s.rooms), len(a.rooms))))

    return propose


@pytest.mark.parametrize(("rooms", "few"), [(2, True), (9, False)])
def test_where_one_is_misled_the_others_are_asked_too(rooms: int, few: bool) -> None:
    truth = drawn_from(PLAN, "real", 2, rooms)
    assert (len(truth.s_graph.wall_surfaces) <= FEW) is few
    alone, helped = (
        DeformableMatcher(misled_by(truth), o).match(truth.s_graph, PLAN) for o in (None, voting_proposals)
    )
    assert alone.status == "none" and share_right(alone, truth) < 0.2
    assert share_right(helped, truth) > 0.85
