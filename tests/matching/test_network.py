"""The network and its features: invariances, consensus, learning, files."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
import torch
from plans import a_graph, box, flat, merged

from data import Floor, Room, SceneGraph, UserError, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher
from matching.learned import LearnedProposer
from matching.learned.network import CompiledNetwork
from matching.learned.proposer import ENOUGH, SHIPPED
from matching.learned.torch_weights import load_network, save_network
from matching.learned.weights_file import load_learned
from matching.network.candidates import Batched, expanded, first_candidates
from matching.network.dimensions import Settings
from matching.network.encoder import GraphTensors
from matching.network.features import PairRows, map_features, plan_features
from matching.network.network import MatchingNetwork
from matching.network.relations import close, compared
from matching.training.data import Batch, batch_of, part, varied
from matching.training.loss import accuracies, loss, run

SMALL = Settings(width=32, layers=2, candidates=8, cycles=2, rounds=2)
# Of an untrained network's candidates, which are all alike, the seventh and the eighth are told apart.
SEVEN = dataclasses.replace(SMALL, candidates=7)
CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def plan() -> SceneGraph:
    return a_graph(flat(np.random.default_rng(3), 10, 8))


@pytest.fixture(scope="module")
def drawn(plan: SceneGraph) -> DrawnGraph:
    return draw(plan, "drift", np.random.default_rng(1), 3)


def untrained(settings: Settings = SMALL) -> MatchingNetwork:
    torch.manual_seed(0)
    return MatchingNetwork(settings).eval().requires_grad_(False)


def moved(g: SceneGraph, T: tuple[float, float, float], mirror: bool = False) -> SceneGraph:
    """The graph after a motion, mirrored before it."""
    def point(p: tuple[float, float]) -> tuple[float, float]:
        x, y = se2.apply(np.array(T), np.array([-p[0] if mirror else p[0], p[1]])).tolist()
        return x, y

    def normal(n: tuple[float, float]) -> tuple[float, float]:
        x, y = se2.rotate(T[0], np.array([-n[0] if mirror else n[0], n[1]])).tolist()
        return x, y

    return dataclasses.replace(
        g, rooms=tuple(dataclasses.replace(r, centroid=point(r.centroid), polygon=None) for r in g.rooms),
        wall_surfaces=tuple(
            dataclasses.replace(w, centroid=point(w.centroid), normal=normal(w.normal)) for w in g.wall_surfaces
        ),
    )  # fmt: skip


def table(proposer: LearnedProposer, s: SceneGraph, a: SceneGraph) -> dict[tuple[str, str], float]:
    """All proposals by ids."""
    found = proposer.propose(s, a)
    pairs = {}
    for of, in_s, in_a in ((found.walls, s.wall_surfaces, a.wall_surfaces), (found.rooms, s.rooms, a.rooms)):
        for k, (partner, score) in enumerate(zip(of.partner, of.score, strict=True)):
            pairs |= {(in_s[k].id, in_a[j].id): float(p) for j, p in zip(partner, score, strict=True) if j >= 0}
    return pairs


def assert_same(found: dict[tuple[str, str], float], expected: dict[tuple[str, str], float]) -> None:
    """The same but for the least likely, whose order is chance."""
    for pair, p in expected.items():
        assert found.get(pair, 0.0) == pytest.approx(p, abs=2e-3) or p < 0.05, pair


@pytest.mark.parametrize("T", [(0.0, 400000.0, 5600000.0), (2.3, -3.0, 8.0), (np.pi / 2, 0.0, 0.0)])
def test_proposals_do_not_know_where_the_graphs_lie(plan: SceneGraph, drawn: DrawnGraph, T: tuple[float, float, float]):
    proposer = LearnedProposer(CompiledNetwork.of(untrained(SEVEN)))
    expected = table(proposer, drawn.s_graph, plan)
    assert_same(table(proposer, moved(drawn.s_graph, T), plan), expected)
    assert_same(table(proposer, drawn.s_graph, moved(plan, T)), expected)


def test_proposals_do_not_know_the_order_of_nodes(plan: SceneGraph, drawn: DrawnGraph):
    rng = np.random.default_rng(0)

    def shuffled(g: SceneGraph) -> SceneGraph:
        walls, rooms = rng.permutation(len(g.wall_surfaces)), rng.permutation(len(g.rooms))
        surfaces = tuple(g.wall_surfaces[k] for k in walls)
        return dataclasses.replace(g, wall_surfaces=surfaces, rooms=tuple(g.rooms[k] for k in rooms))

    proposer = LearnedProposer(CompiledNetwork.of(untrained(SEVEN)))
    found = table(proposer, shuffled(drawn.s_graph), shuffled(plan))
    assert_same(found, table(proposer, drawn.s_graph, plan))


def test_a_mirrored_building_looks_different(plan: SceneGraph):
    network = untrained()

    def vectors(g: SceneGraph) -> torch.Tensor:
        return network.encode(GraphTensors.of(plan_features(g))).walls

    seen, turned = vectors(plan), vectors(moved(plan, (0.7, 3.0, 1.0)))
    mirrored = vectors(moved(plan, (0.0, 0.0, 0.0), mirror=True))
    noise = float((seen - turned).abs().max())
    assert noise < 1e-4
    assert (seen - mirrored).abs().max() > 20 * noise


def test_only_nodes_of_one_storey_are_neighbours(plan: SceneGraph):
    lower = a_graph(flat(np.random.default_rng(3), 14, 10), "low", "l")
    upper = a_graph(flat(np.random.default_rng(3), 14, 10), "high", "u")
    both = dataclasses.replace(merged(lower, upper), floors=(Floor("low"), Floor("high")))
    f = plan_features(both)
    real = f.neighbour >= 0
    assert (f.floor[f.neighbour] == f.floor[:, None])[real].all()
    alone = plan_features(lower)
    assert np.allclose(f.edge[: len(alone)], alone.edge, atol=1e-5)
    assert f.rooms == tuple(r.id for r in both.rooms)


def test_neighbours_are_the_nearest_and_facing_sides_are_marked():
    f = plan_features(a_graph([box(0, 0, 4, 3), box(4.2, 0, 4, 3)]))
    index = {w: k for k, w in enumerate(f.walls)}
    facing = -5  # same room, facing, both walls, wall of room, room of wall
    pairs = {
        (f.walls[i], f.walls[f.neighbour[i, k]])
        for i in index.values() for k in range(f.edge.shape[1]) if f.edge[i, k, facing + 1] > 0
    }  # fmt: skip
    assert len(pairs) == 2  # one wall between the rooms, seen from either side
    (p, q), (q_, p_) = sorted(pairs)
    assert (p, q) == (p_, q_) and p.split("/")[0] != q.split("/")[0]


def learned_pair(plan: SceneGraph, drawn: DrawnGraph) -> tuple[MatchingNetwork, Batch, list[float]]:
    torch.manual_seed(0)
    network, batch = MatchingNetwork(SMALL), batch_of([(plan, [drawn])])
    optimizer = torch.optim.AdamW(network.parameters(), 3e-3)
    losses = []
    for _ in range(80):
        value = loss(*run(network, batch, CPU))
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        losses.append(value.item())
    return network, batch, losses


@pytest.mark.slow
def test_a_pair_is_learned_by_heart(plan: SceneGraph, drawn: DrawnGraph):
    network, batch, losses = learned_pair(plan, drawn)
    assert losses[1] < losses[0] and losses[-1] < 0.3 * losses[0]
    found = accuracies(*run(network, batch, CPU))
    assert found["walls"][0] > 0.8 and found["rooms"][0] == 1.0
    proposer = LearnedProposer(CompiledNetwork.of(network.eval().requires_grad_(False)), enough=1.0)
    told = table(proposer, moved(drawn.s_graph, (1.0, 5.0, 6.0)), plan)
    right = [told.get(pair, 0.0) > 0.3 for pair in drawn.wall_surfaces.items()]
    assert np.mean(right) > 0.75
    sums = proposer.propose(drawn.s_graph, plan).walls.score.sum(axis=1)
    assert (sums <= 1 + 1e-5).all()


def test_batches_are_worked_on_as_single_pairs_are(plan: SceneGraph, drawn: DrawnGraph):
    other = a_graph(flat(np.random.default_rng(8), 11, 9))
    second, third = (draw(g, "real", np.random.default_rng(2), 3) for g in (plan, other))
    network = untrained()
    whole, _ = run(network, batch_of([(plan, [drawn, second]), (other, [third])]), CPU)
    first = 0
    for g, d in ((plan, drawn), (plan, second), (other, third)):
        alone, _ = run(network, batch_of([(g, [d])]), CPU)
        rows = slice(first, first + len(d.s_graph.wall_surfaces))
        first = rows.stop
        value, expected = (o.walls[-1][1].softmax(dim=-1) for o in (whole, alone))
        assert torch.allclose(value[rows].sort(dim=1).values[:, -3:], expected.sort(dim=1).values[:, -3:], atol=0.02)


@pytest.mark.parametrize(
    ("noise", "rooms", "whole"), [("drift", 3, False), ("mis_segmented", 2, True), ("real", 1, False)]
)
def test_the_compiled_network_says_what_the_network_says(plan: SceneGraph, noise: str, rooms: int, whole: bool):
    s, a = draw(plan, noise, np.random.default_rng(7), rooms).s_graph, plan
    if whole:  # a plan of two storeys, the lower one without rooms
        lower = dataclasses.replace(plan, rooms=(), wall_surfaces=tuple(
            dataclasses.replace(w, id=f"l{w.id}", room=None, floor="lower") for w in plan.wall_surfaces))
        upper = tuple(dataclasses.replace(w, floor="upper") for w in plan.wall_surfaces)
        a = dataclasses.replace(
            plan, rooms=tuple(dataclasses.replace(r, floor="upper") for r in plan.rooms),
            wall_surfaces=upper + lower.wall_surfaces, floors=(Floor("upper"), Floor("lower")))
    network = untrained(Settings(candidates=5))
    f, g = map_features(s), plan_features(a)
    pair = PairRows(*((0, len(x)) for x in (f.walls, g.walls, f.rooms, g.rooms)))
    with torch.inference_mode():
        output = network(network.encode(GraphTensors.of(f)), network.encode(GraphTensors.of(g)), [pair])
    compiled = CompiledNetwork.of(network)
    found = compiled.match(compiled.encode(f), compiled.encode(g), enough=1.0)
    column, odds = output.walls[-1]
    np.testing.assert_array_equal(found.column, column.numpy())
    assert (found.column[:, 5:] >= 0).any(), "candidates come from later cycles too"
    np.testing.assert_allclose(np.log(found.walls + 1e-9), np.log(odds.softmax(-1)[:, :-1].numpy() + 1e-9), atol=1e-3)
    np.testing.assert_allclose(found.walls, odds.softmax(-1)[:, :-1].numpy(), atol=1e-5)
    np.testing.assert_allclose(found.rooms, output.rooms[-1].softmax(-1)[:, :-1].numpy(), atol=1e-5)


def test_empty_graphs_and_walls_without_rooms_are_answered(plan: SceneGraph, drawn: DrawnGraph):
    proposer, nothing = LearnedProposer(CompiledNetwork.of(untrained())), SceneGraph("map")
    assert proposer.propose(nothing, plan).walls.partner.shape[0] == 0
    assert (proposer.propose(drawn.s_graph, nothing).walls.partner >= 0).sum() == 0
    stray = dataclasses.replace(
        drawn.s_graph, rooms=(Room("empty", (0.0, 0.0)),),
        wall_surfaces=tuple(dataclasses.replace(w, room=None, length=None) for w in drawn.s_graph.wall_surfaces),
    )  # fmt: skip
    found = proposer.propose(stray, plan)
    assert len(found.rooms.partner) == 1 and (found.rooms.partner >= 0).sum() == 0
    assert np.isfinite(found.walls.score).all() and (found.walls.partner >= 0).any()
    one = SceneGraph("map", (), (WallSurface("w", None, (0.0, 0.0), (1.0, 0.0), 2.0),))
    assert np.isfinite(proposer.propose(one, plan).walls.score).all()
    assert np.isfinite(proposer.propose(one, one).walls.score).all()
    assert len(map_features(nothing)) == 0


@pytest.mark.parametrize("suffix", [".pt", ".npz"])
def test_a_network_is_read_as_it_was_written(tmp_path: Path, plan: SceneGraph, drawn: DrawnGraph, suffix: str):
    network, path = untrained(), tmp_path / f"n{suffix}"
    save_network(path, network)
    again = load_network(path)
    assert again.settings == SMALL and not again.training
    for (name, one), other in zip(network.state_dict().items(), again.state_dict().values(), strict=True):
        assert other.dtype == torch.float32 and torch.allclose(one, other, rtol=1e-3, atol=1e-6), name
    expected = table(LearnedProposer(CompiledNetwork.of(again)), drawn.s_graph, plan)
    assert table(LearnedProposer.load(path), drawn.s_graph, plan) == expected
    save_network(tmp_path / f"again{suffix}", again)
    assert (tmp_path / f"again{suffix}").stat().st_size == path.stat().st_size


def test_files_of_torch_that_are_no_networks_are_refused(tmp_path: Path):
    save_network(tmp_path / "n.pt", untrained())
    value = torch.load(tmp_path / "n.pt", weights_only=True)
    state = value["state"]
    for name, broken in (
        ("short", {**value, "state": dict(list(state.items())[1:])}),
        ("size", {**value, "settings": {**value["settings"], "width": 64}}),
        ("odd", {**value, "settings": {**value["settings"], "width": 33}}),
        ("infinite", {**value, "state": {**state, "sharpness": torch.full_like(state["sharpness"], torch.nan)}}),
        ("version", {**value, "version": 99}),
        ("other", {"weights": 1}),
    ):
        torch.save(broken, tmp_path / name)
        with pytest.raises(UserError, match=name):
            load_network(tmp_path / name)
    (tmp_path / "text").write_text("not a network")
    (tmp_path / "cut").write_bytes((tmp_path / "n.pt").read_bytes()[:500])
    for name in ("text", "cut", "missing"):
        with pytest.raises(UserError, match=name):
            load_network(tmp_path / name)


def test_varied_plans_keep_their_walls_on_their_rooms(plan: SceneGraph):
    for seed in range(4):
        a = varied(plan, np.random.default_rng(seed))
        for w in a.wall_surfaces:
            room = shapely.Polygon(a.room_by_id[w.room or ""].polygon)
            step = np.array(w.centroid) + 0.02 * np.array(w.normal)
            assert shapely.contains_xy(room, *step)
            assert all(room.exterior.distance(shapely.Point(e)) < 1e-6 for e in w.ends())


def test_parts_of_plans_are_whole_rooms(plan: SceneGraph):
    a = part(plan, 20, np.random.default_rng(0))
    assert 20 < len(a.wall_surfaces) < len(plan.wall_surfaces)
    for r in a.rooms:
        assert {w.id for w in a.surfaces_of_room[r.id]} == {w.id for w in plan.surfaces_of_room[r.id]}


def test_candidates_spread_from_neighbour_to_neighbour(plan: SceneGraph):
    """Where every other wall knows its partner, the others are offered theirs."""
    s, a = (GraphTensors.of(plan_features(g)) for g in (moved(plan, (0.4, 3.0, 1.0)), plan))
    n = len(plan.wall_surfaces)
    batched = Batched.of(s, a, [PairRows((0, n), (0, n), (0, len(plan.rooms)), (0, len(plan.rooms)))])
    dense = torch.full((n, n + 1), -9.0)
    told = torch.arange(n) % 2 == 0
    own = torch.arange(n)
    dense[own, torch.where(told, own, (own + 7) % n)] = 9.0
    known = first_candidates(dense, batched, 1)
    found = expanded(s, a, batched, dense, known, known.likely * told[:, None], more=2)
    offered = (found.column == own[:, None]).any(dim=1)
    assert offered[told].all() and offered[~told].float().mean() > 0.9
    assert (found.likely.sum(dim=1) <= 1 + 1e-5).all()
    right = found.likely.gather(1, (found.column == own[:, None]).long().argmax(dim=1, keepdim=True))[:, 0]
    assert (right[~told & offered] > 0).all()


def test_support_is_for_combinations_that_are_alike(plan: SceneGraph):
    s, a = (GraphTensors.of(plan_features(g)) for g in (moved(plan, (-2.0, 3.0, 1.0)), plan))
    mirrored = GraphTensors.of(plan_features(moved(plan, (0.0, 0.0, 0.0), mirror=True)))
    i, j = torch.arange(6), torch.arange(1, 7)
    assert (close(s, a, (i, j), (i, j)) > 0.99).all()
    assert (close(s, mirrored, (i, j), (i, j)) < 0.5).any()
    kept, feature = compared(s, a, (i, j), (i, j))
    assert len(kept) == 6 and torch.isfinite(feature).all()
    assert len(compared(s, a, (i, j), (i, j + 9))[0]) < 6


def test_the_shipped_network_finds_a_map_that_bends(plan: SceneGraph, drawn: DrawnGraph):
    found = Matcher.load("learned").match(drawn.s_graph, plan)
    pairs = {(s, a) for s, a, _ in found.wall_surfaces}
    assert np.mean([pair in pairs for pair in drawn.wall_surfaces.items()]) > 0.85
    assert {(s, a) for s, a, _ in found.rooms} == set(drawn.rooms.items())
    assert SHIPPED.stat().st_size < 5e6


def test_a_network_that_is_sure_stops_early(plan: SceneGraph):
    network = load_learned(SHIPPED)
    s = network.encode(map_features(draw(plan, "real", np.random.default_rng(2)).s_graph))
    a = network.encode(plan_features(plan))
    short, whole = (network.match(s, a, enough) for enough in (ENOUGH, 1.0))
    assert short.column.shape[1] < whole.column.shape[1]  # each cycle adds candidates
    best = [np.take_along_axis(f.column, f.walls.argmax(axis=1)[:, None], axis=1) for f in (short, whole)]
    assert (best[0] == best[1]).mean() > 0.9


def test_weights_are_for_the_learned_method_alone(tmp_path: Path):
    with pytest.raises(UserError, match="takes no weights"):
        Matcher.load("voting", weights=tmp_path / "n.pt")
    with pytest.raises(UserError, match="nowhere"):
        Matcher.load("learned", weights=tmp_path / "nowhere.pt")


@pytest.mark.slow
def test_a_match_takes_no_torch(tmp_path: Path, plan: SceneGraph, drawn: DrawnGraph):
    for name, graph in (("s", drawn.s_graph), ("a", plan)):
        graph.save(tmp_path / f"{name}.json")
    code = (
        "import sys; from matching.match import main; status = main(sys.argv[1:])\n"
        "assert status == 0 and 'torch' not in sys.modules"
    )
    given = ["--s-graph", tmp_path / "s.json", "--a-graph", tmp_path / "a.json", "--out", tmp_path / "matches.json"]
    done = subprocess.run([sys.executable, "-c", code, *map(str, given)], timeout=300, check=False)
    assert done.returncode == 0 and json.loads((tmp_path / "matches.json").read_text())["wall_surfaces"]
