"""The compiled loops over fields of motions, against plain definitions of what they work out."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import torch
from plans import a_graph, flat

from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import draw
from matching.arrays import Doors, arrays
from matching.deformation import deformed_hypotheses as bent
from matching.deformation import field_step
from matching.deformation.assignment import _merit
from matching.deformation.field import STEP, Fields, Scene, judge, motions, rigid_state
from matching.deformation.field_partners import GATE_M, GATE_RAD, PARTNERS, partners
from matching.deformation.local_motions import local_motions
from matching.network import consensus
from matching.network.encoder import GraphTensors
from matching.network.features import map_features, plan_features
from matching.network.support_loops import combinations
from matching.search import TopK
from matching.search.groups import BESIDE, POINTS, groups
from matching.search.plan_walls import PlanWalls
from matching.search.scoring import Pairing, explained, fit
from matching.search.voting import vote

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
DRAWN = draw(PLAN, "real", np.random.default_rng(1), 5)


@pytest.fixture(scope="module")
def scene() -> Scene:
    walls = PlanWalls.of(PLAN)
    assert walls is not None
    return bent.scene_of(DRAWN.s_graph, walls)


@pytest.fixture
def fields(scene) -> Fields:
    """Maps laid anywhere, each of their rooms a little aside."""
    rng = np.random.default_rng(0)
    rigid = np.column_stack((np.pi / 2 * rng.integers(-9, 9, 6), rng.uniform(-3, 3, (6, 2))))
    state = rigid_state(scene, rigid)
    return Fields(np.zeros(6, dtype=np.int64), state + rng.normal(0, 0.07, state.shape))


def laid(scene: Scene, state: Array) -> tuple[Array, Array]:
    """(K, Ns) headings and (K, Ns, 2) mid points of the map's walls."""
    own = motions(scene, state)[:, scene.groups.of_wall]
    return scene.s.heading + own[..., 0], se2.apply(own, scene.s.centre)


def residuals(scene: Scene, state: Array, i: int, j: int) -> tuple[float, float, float, float]:
    """Of a wall of the map (one field) to a wall of the plan: across, along, turned, and how far its end stands out."""
    s, plan = scene.s, scene.plan
    heading, at = laid(scene, state[None])
    off = at[0, i] - plan.centre[j]
    normal = np.array([np.cos(plan.heading[j]), np.sin(plan.heading[j])])
    along = float(off @ [-normal[1], normal[0]])
    beyond = np.sign(along) * max(abs(along) - abs(plan.half[j] - s.half[i]), 0.0)
    return float(off @ normal), along, float(se2.wrap(heading[0, i] - plan.heading[j])), float(beyond)


def test_partners_are_the_nearest_walls_of_a_direction(scene, fields):
    close = replace(scene.plan.storeys[0], centre=0.25 * scene.plan.centre)  # so close that some walls have too many
    plan = replace(scene.plan, storeys=(close,), centre=close.centre)
    scene = replace(scene, plan=plan)
    heading, at = laid(scene, fields.state)
    table = partners(scene, fields)
    full = 0
    for k, i in np.ndindex(*heading.shape):
        off = at[k, i] - plan.centre
        across = np.abs(np.cos(plan.heading) * off[:, 0] + np.sin(plan.heading) * off[:, 1])
        along = np.abs(np.cos(plan.heading) * off[:, 1] - np.sin(plan.heading) * off[:, 0])
        cost = across + np.maximum(along - plan.half - scene.s.half[i], 0.0)
        near = np.flatnonzero((cost <= GATE_M) & (np.abs(se2.wrap(plan.heading - heading[k, i])) <= GATE_RAD))
        found = table[k, i][table[k, i] >= 0]
        assert set(found) <= set(near) and len(set(found)) == min(len(near), PARTNERS)
        np.testing.assert_allclose(cost[found], np.sort(cost[near])[:PARTNERS], atol=1e-9)
        full += len(near) > PARTNERS
    assert 0 < full < heading.size


def test_pairs_are_judged_by_their_residuals(scene, fields):
    table = partners(scene, fields)
    now = judge(scene, table, fields.state, 0.2)
    for k, i, p in np.argwhere(table >= 0)[::7].tolist():
        across, along, turned, _ = residuals(scene, fields.state[k], i, int(table[k, i, p]))
        np.testing.assert_allclose((now.across[k, i, p], now.along[k, i, p], now.turned[k, i, p]),
                                   (across, along, turned), atol=1e-9)  # fmt: skip
        bare = np.exp(-0.5 * (across / 0.2) ** 2 - 0.5 * (turned / (np.radians(5) * 4 / 3)) ** 2)
        assert now.quality[k, i, p] == pytest.approx(now.beside[k, i, p] * bare)
        if now.beside[k, i, p] == 0:  # it may stand out by a fifth of its length, of 4 m at most
            assert abs(along) >= scene.s.half[i] + scene.plan.half[table[k, i, p]] - 1e-9
    assert (now.quality[table < 0] == 0).all() and now.quality.max() > 0.5


def numbers(scene: Scene, state: Array, partner: Array) -> Array:
    """All that a step makes small: of each wall across, along and turned, then of each pair of neighbours."""
    walls = [residuals(scene, state, i, int(j)) for i, j in enumerate(partner)]
    own = motions(scene, state[None])[0]
    found = [(across, beyond, turned) for across, _, turned, beyond in walls]
    for g, h in scene.groups.edges.tolist():
        middle = [se2.apply(own[x], scene.groups.centre[[g, h]].mean(axis=0)) for x in (g, h)]
        found.append((float(se2.wrap(own[h, 0] - own[g, 0])), *(middle[1] - middle[0])))
    return np.array(found)


def test_a_step_is_that_of_weighted_least_squares(scene):
    T_plan_a = se2.inverse(scene.plan.storeys[0].T_graph_own)
    true = se2.compose(se2.compose(T_plan_a, np.array(DRAWN.T_a_s)), scene.s.T_graph_own)
    state = rigid_state(scene, true[None])
    state += np.random.default_rng(2).normal(0, 0.02, state.shape)
    sigma = np.full(state.shape[:2], 0.3)
    table = partners(scene, Fields(np.zeros(1, dtype=np.int64), state))
    quality = judge(scene, table, state, 0.3).quality[0]
    best = quality.argmax(axis=1)
    partner, quality = table[0, np.arange(len(best)), best], quality.max(axis=1)
    assert (quality > 0.2).mean() > 0.5
    weight = quality * scene.s.weight / 0.3**2
    sharp = field_step.SHARPEST**2 / (field_step.SIGMA_TILT**2 + (field_step.OFF_LINE / scene.s.half) ** 2)
    of_walls = np.stack((weight, 0.25 * (0.3 / 0.4) ** 2 * weight, sharp * weight), axis=-1)
    slack = STEP * scene.groups.slack[:, None]
    now = numbers(scene, state[0], partner)
    strained = np.sum((now[len(partner) :] / slack) ** 2, axis=1, keepdims=True)
    weights = np.concatenate((of_walls, 1 / (slack * (1 + strained / field_step.ROBUST**2)) ** 2)).ravel()
    columns = []
    for n in range(state.size):
        little = np.zeros(state.size)
        little[n] = 1e-6
        columns.append((numbers(scene, state[0] + little.reshape(-1, 3), partner) - now).ravel() / 1e-6)
    J = np.stack(columns, axis=-1)
    # An end that slides within the plan's wall holds nothing, but the wall's information is reckoned all the same.
    for i, j in enumerate(partner.tolist()):
        n, own = scene.plan.heading[j], scene.groups.of_wall[i]
        lever = laid(scene, state)[1][0, i] - state[0, own, 1:]
        tangent = np.array([-np.sin(n), np.cos(n)])
        J[3 * i + 1, 3 * own : 3 * own + 3] = tangent @ [-lever[1], lever[0]], *tangent
    held = np.tile(1 / field_step.HELD**2, state.shape[1])
    expected = np.linalg.solve(J.T @ (weights[:, None] * J) + np.diag(held), -J.T @ (weights * now.ravel()))
    moved = field_step.step(scene, table, state, sigma) - state
    moved[..., 0] = se2.wrap(moved[..., 0])
    np.testing.assert_allclose(moved.ravel(), expected, atol=1e-5)
    assert np.abs(expected).max() > 0.01


def test_rooms_count_more_where_the_centroid_lies_in_their_footprint():
    rng = np.random.default_rng(5)
    rooms = [shapely.Point(*rng.uniform(-3, 3, 2)).buffer(2, 3).difference(shapely.box(*rng.uniform(-1, 0, 2), 4, 4))
             for _ in range(9)]  # fmt: skip
    rings = [np.array(r.exterior.coords)[:-1] for r in rooms if r.geom_type == "Polygon"]
    first = np.cumsum([0, *map(len, rings)])
    points, share = rng.uniform(-4, 4, (200, 2)), np.full((200, len(rings)), 0.5)
    share[::2] = 0.1
    more = _merit(share, points, np.concatenate(rings), first) > share
    inside = np.array([shapely.contains_xy(shapely.Polygon(r), *points.T) for r in rings]).T
    assert inside.any()
    np.testing.assert_array_equal(more, inside & (share > 0.2))


def test_motions_explain_what_their_fit_explains(scene):
    s, a = scene.s, scene.plan.storeys[0]
    motions_ = np.random.default_rng(3).uniform((-0.1, -6, -6), (0.1, 6, 6), (40, 3))
    pairing = Pairing.near(s, a, 0.02)
    expected = s.weight @ fit(pairing, pairing.state(motions_), 0.4).quality.max(axis=2)
    np.testing.assert_allclose(explained(s, a, 0.02, motions_, 0.4), expected, atol=1e-9)
    assert expected.max() > 0.2 * s.weight.sum()


def test_a_storey_laid_elsewhere_is_voted_back(scene):
    marks = scene.plan.corners[0]
    moved = replace(marks, point=se2.apply(np.array([0.7, 31.0, -8.0]), marks.point), heading=marks.heading + 0.7)
    best = [mode.motions[0] for mode in vote(marks, moved, 3)]
    assert min(np.abs(motion - (0.7, 31.0, -8.0)).max() for motion in best) < 1e-9


def test_proposals_that_are_right_vote_for_the_true_motion(scene):
    place = {name: n for n, name in enumerate(scene.plan.storeys[0].ids)}
    partner = np.array([[place.get(DRAWN.wall_surfaces.get(i, ""), -1)] for i in scene.s.ids])
    found = local_motions(scene, TopK(partner, (partner >= 0).astype(float)))
    T_plan_a = se2.inverse(scene.plan.storeys[0].T_graph_own)
    true = se2.compose(se2.compose(T_plan_a, np.array(DRAWN.T_a_s)), scene.s.T_graph_own)
    off = found.motion[0] - true
    assert abs(se2.wrap(off[:1])[0]) < 0.03 and np.hypot(*off[1:]) < 0.3
    assert found.worth[0] > 0.5 * scene.s.weight.sum()


def test_rooms_are_neighbours_by_the_gap_between_their_walls(scene):
    s = scene.s
    of = groups(s, Doors(np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64)))
    rows = [s.centre[i] + np.linspace(-1, 1, 200)[:, None] * s.half[i] * s.tangent[i] for i in range(len(s))]
    for g, h in np.argwhere(np.triu(np.ones((len(of), len(of))), 1)).tolist():
        one, other = (np.concatenate([rows[i] for i in np.flatnonzero(of.of_wall == x)]) for x in (g, h))
        gap = np.hypot(*np.moveaxis(one[:, None] - other, -1, 0)).min()
        joined = [g, h] in of.edges.tolist()
        assert joined or gap > BESIDE - POINTS / 2 or np.count_nonzero(of.edges == g) >= 6, (g, h, gap)
        assert not joined or gap < BESIDE + 2 * POINTS or len(of.edges) == len(of) - 1, (g, h, gap)


def test_combinations_of_candidates_are_those_of_the_tensors():
    s, a = GraphTensors.of(map_features(DRAWN.s_graph)), GraphTensors.of(plan_features(PLAN))
    rng = torch.Generator().manual_seed(4)
    n = len(s.wall_node)
    candidate = torch.randint(-1, len(a.wall_node), (n, 7), generator=rng)
    true = {name: k for k, name in enumerate(plan_features(PLAN).walls)}
    candidate[:, 0] = torch.tensor(
        [true.get(DRAWN.wall_surfaces.get(i, ""), -1) for i in map_features(DRAWN.s_graph).walls]
    )
    rows = [consensus.wall_rows(g) for g in (s, a)]
    mine = combinations(*rows, candidate.numpy())
    plain = consensus._support(s, a, candidate, consensus.wall_neighbours(s), 0, n)
    orders = [np.lexsort((np.asarray(found[1]), np.asarray(found[0]))) for found in (mine, plain)]
    assert len(plain[0]) > 50
    for one, other in zip(mine, plain, strict=True):
        np.testing.assert_allclose(one[orders[0]], other.numpy()[orders[1]], rtol=1e-4, atol=2e-5)
    assert len(combinations(*rows, np.full((n, 7), -1))[0]) == 0


def test_neighbours_of_walls_are_the_nearest_by_gap():
    walls, found = arrays(DRAWN.s_graph, None, list(DRAWN.s_graph.wall_surfaces)), map_features(DRAWN.s_graph)
    lines = [
        shapely.LineString([c - h * t, c + h * t])
        for c, h, t in zip(walls.centre, walls.half, walls.tangent, strict=True)
    ]
    for i, line in enumerate(lines):
        own = found.neighbour[i][found.neighbour[i] >= 0]
        walls_of = own[own < len(walls)]
        assert i not in walls_of and len(set(walls_of)) == len(walls_of)
        touching = [j for j, other in enumerate(lines) if j != i and line.distance(other) < 0.1]
        assert len(touching) > 10 or set(touching) <= set(walls_of)
