"""The published matcher: its layers against slow formulas, its edges, its training, its answers, its commands."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from plans import a_graph, box, flat

from data import Door, SceneGraph, UserError
from data.scene_graph.motion import moved
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.published.data import PaperPair, PaperSplit, drawn_pairs, laid_out, pair_of, split
from matching.published.graph import paper_graph
from matching.published.matcher import PaperMatcher
from matching.published.network import PRESETS, PUBLISHED, REPOSITORY, GATv2, Nodes, PaperNetwork
from matching.published.sinkhorn import soft_assignment
from matching.published.train import main as train_command
from matching.published.trainer import PaperTraining, Recipe, Row, evaluate, train
from matching.published.weights import load_paper_network, save_paper_network

TINY = replace(REPOSITORY, hidden=16, out=8)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def plan() -> SceneGraph:
    return a_graph(flat(np.random.default_rng(3), 10, 8))


def untrained(seed: int = 0) -> PaperNetwork:
    torch.manual_seed(seed)
    return PaperNetwork(TINY).eval().requires_grad_(False)


def test_attention_is_that_of_the_formula():
    torch.manual_seed(1)
    layer = GATv2(5, 3, heads=2, drop=0.5).eval().requires_grad_(False)
    x, edges = torch.randn(6, 5), torch.tensor([[0, 1, 2, 4, 5], [3, 3, 3, 0, 4]])
    out = layer(x, edges)
    for v in range(6):
        near = [v, *(u for u, w in edges.T.tolist() if w == v)]
        heads = []
        for h in range(2):
            rows = slice(3 * h, 3 * h + 3)
            source, target = ((w.weight[rows], w.bias[rows]) for w in (layer.source, layer.target))
            sent = [source[0] @ x[u] + source[1] for u in near]
            heard = target[0] @ x[v] + target[1]
            score = [layer.attention[h] @ torch.where(m + heard > 0, m + heard, 0.2 * (m + heard)) for m in sent]
            weight = torch.stack(score).softmax(dim=0)
            heads.append(sum(w * m for w, m in zip(weight, sent, strict=True)))
        assert torch.allclose(out[v], sum(heads) / 2 + layer.bias, atol=1e-6)


def test_sizes_are_those_of_the_published_networks():
    parameters = {name: sum(p.numel() for p in PaperNetwork(s).parameters()) for name, s in PRESETS.items()}
    assert parameters == {"published": 55_074, "repository": 50_754}


def test_order_of_nodes_and_of_pairs_does_not_matter(plan: SceneGraph):
    network = untrained()
    s = draw(plan, "paper", np.random.default_rng(0)).s_graph
    turned = replace(s, rooms=s.rooms[::-1], wall_surfaces=s.wall_surfaces[::-1])
    a, one, other = (paper_graph(g) for g in (plan, s, turned))
    soft, again = network(Nodes.of([a, a]), Nodes.of([one, other]))
    order = [other.ids.index(name) for name in one.ids]
    assert torch.allclose(soft, again[:, order], atol=1e-6)
    assert torch.allclose(soft, network(Nodes.of([a]), Nodes.of([one]))[0], atol=1e-6)


@pytest.mark.parametrize("shape", [(7, 4), (4, 7), (5, 5)])
def test_sinkhorn_is_that_of_the_square_matrix_with_dummies(shape: tuple[int, int]):
    torch.manual_seed(0)
    affinity = torch.randn(shape)
    tall = affinity.T if shape[0] < shape[1] else affinity
    square = torch.full((len(tall), len(tall)), -100.0, dtype=torch.double)
    square[:, : tall.shape[1]] = tall.double() / 0.3
    for k in range(12):
        square = square - square.logsumexp(dim=k % 2, keepdim=True)
    slow = square.exp()[:, : tall.shape[1]]
    assert torch.allclose(soft_assignment(affinity, 0.3, 12).double(), slow.T if tall is not affinity else slow)


def test_marginals_of_sinkhorn():
    torch.manual_seed(0)
    soft = soft_assignment(torch.randn(9, 5), 0.2, 300)
    assert torch.allclose(soft.sum(dim=0), torch.ones(5), atol=1e-4)
    assert (soft.sum(dim=1) < 1 + 1e-6).all() and (soft >= 0).all()
    wild = soft_assignment(1e4 * torch.randn(9, 5), 0.01, 100)
    assert torch.isfinite(wild).all()


def two_rooms() -> SceneGraph:
    """Side by side, a wall of 0.2 m between them, with a door."""
    graph = a_graph([box(0, 0, 4, 3), box(4.2, 0, 3, 3)])
    return replace(graph, doors=(Door("d", ("room0", "room1"), (4.1, 1.5)),))


def named(graph: SceneGraph, edges: str, *without: str) -> set[tuple[str, str]]:
    found = paper_graph(graph, edges, without)
    return {(found.ids[u], found.ids[v]) for u, v in found.edges.T.tolist()}


def test_edges_of_the_text():
    graph = two_rooms()
    edges = named(graph, "paper")
    belongs = {(w.room, w.id) for w in graph.wall_surfaces}
    assert belongs <= edges
    assert {("room0", "room1"), ("room1", "room0")} <= edges
    ring = edges - belongs - {("room0", "room1"), ("room1", "room0")}
    assert len(ring) == 8
    of_id = graph.surface_by_id
    for u, v in ring:  # to the left, a quarter of a turn on in a rectangle
        m, n = of_id[u].normal, of_id[v].normal
        assert of_id[u].room == of_id[v].room and m[0] * n[1] - m[1] * n[0] == pytest.approx(1)
    apart = a_graph([box(0, 0, 4, 3), box(6, 0, 3, 3)])
    assert not any(u.startswith("room0") and v.startswith("room1") for u, v in named(apart, "paper"))


def test_edges_of_the_code():
    graph = two_rooms()
    edges = named(graph, "code")
    belongs = {(w.room, w.id) for w in graph.wall_surfaces}
    assert edges - belongs == {("room0", "room1")} | {
        (f"room{r}/{i}", f"room{r}/{j}") for r in (0, 1) for i, j in ((0, 1), (1, 2), (2, 3), (0, 3))
    }
    assert named(replace(graph, doors=()), "code") == edges - {("room0", "room1")}


def test_what_is_left_out():
    graph = two_rooms()
    belongs = {(w.room, w.id) for w in graph.wall_surfaces}
    assert named(graph, "paper", "rooms", "ring") == belongs
    assert named(graph, "paper", "ring") == belongs | {("room0", "room1"), ("room1", "room0")}
    assert len(PaperNetwork(replace(TINY, without=("mlp",))).mlp) == 0


def test_features_of_nodes():
    graph = two_rooms()
    found = paper_graph(graph)
    assert found.features[0] == pytest.approx([1, 0, 2, 1.5, 0, 0, -1])
    wall = graph.surface_by_id["room1/0"]
    row = found.features[found.ids.index("room1/0")]
    assert row == pytest.approx([0, 1, *wall.centroid, *wall.normal, wall.length])


def test_plans_are_laid_where_the_published_ones_are(plan: SceneGraph):
    a = laid_out(moved(plan, np.array([0.0, 900.0, -700.0])), np.random.default_rng(0))
    assert np.abs(a.centroid()).max() <= 15
    assert [w.length for w in a.wall_surfaces] == [w.length for w in plan.wall_surfaces]
    pair = pair_of("b", a, draw(a, "paper", np.random.default_rng(1)), TINY)
    length = (pair.a.features[pair.match, 6], pair.s.features[:, 6])
    assert (pair.match >= 0).all() and length[0] == pytest.approx(length[1])
    assert pair.assignment().sum() == len(pair.s.ids)


@pytest.fixture(scope="module")
def pairs(plan: SceneGraph) -> list[PaperPair]:
    return drawn_pairs(12, 0, [], TINY)


def test_parts_of_the_set_are_alike_in_size_and_share_no_building(pairs: list[PaperPair]):
    many = [replace(p, group=f"{k // 2}") for k, p in enumerate(pairs * 10)]
    parts = split(many, 0)
    groups = [{p.group for p in part} for part in (parts.train, parts.validation, parts.test)]
    assert sum(map(len, groups)) == len(set.union(*groups)) == 60
    assert [len(g) for g in groups] == [40, 10, 10]
    sizes = [np.mean([len(p.s.ids) for p in part]) for part in (parts.train, parts.validation, parts.test)]
    assert max(sizes) < 1.3 * min(sizes)


def test_training_lowers_the_loss_and_goes_on_bitwise(pairs: list[PaperPair], tmp_path: Path):
    parts = PaperSplit(tuple(pairs[:8]), tuple(pairs[8:11]), ())
    recipe = Recipe(rate=3e-3, batch=4)

    def begun(epochs: int) -> PaperTraining:
        return PaperTraining.begin(TINY, replace(recipe, epochs=epochs), parts, 0)

    def forget(row: Row) -> None:
        assert np.isfinite(row["loss"])

    whole = begun(4)
    assert train(whole, parts, forget) == "all epochs done"
    assert whole.curve[-1]["loss"] < 0.97 * whole.curve[0]["loss"]
    half = begun(2)
    train(half, parts, forget)
    half.save(tmp_path / "checkpoint.pt")
    again = begun(4)
    again.load(tmp_path / "checkpoint.pt")
    train(again, parts, forget)
    assert [r["loss"] for r in again.curve] == [r["loss"] for r in whole.curve]
    state = whole.network.state_dict()
    assert all(torch.equal(v, state[k]) for k, v in again.network.state_dict().items())
    best = evaluate(whole.best_network(), parts.validation)[0]
    assert best == min(r["validation loss"] for r in whole.curve)
    with pytest.raises(UserError, match="another settings"):
        PaperTraining.begin(PUBLISHED, recipe, parts, 0).load(tmp_path / "checkpoint.pt")
    with pytest.raises(UserError, match="another data"):
        others = replace(parts, train=parts.validation)
        PaperTraining.begin(TINY, recipe, others, 0).load(tmp_path / "checkpoint.pt")


def test_training_ends_where_nothing_gets_better(pairs: list[PaperPair]):
    parts = PaperSplit(tuple(pairs[:4]), tuple(pairs[4:8]), ())
    still = PaperTraining.begin(TINY, Recipe(rate=0.0, decay=0.0, batch=4, patience=2), parts, 0)
    assert train(still, parts, lambda row: None) == "no improvement in 2 epochs"
    assert len(still.curve) == 3


def test_pairs_are_one_to_one(plan: SceneGraph, tmp_path: Path):
    save_paper_network(tmp_path / "w.pt", untrained())
    matcher = Matcher.load(f"paper@{tmp_path / 'w.pt'}")
    drawn = draw(plan, "paper", np.random.default_rng(0))
    result = matcher.match(drawn.s_graph, plan)
    assert result.status == "unique" and result.T_a_s is not None
    for pairs in (result.rooms, result.wall_surfaces):
        assert len({i for i, _, _ in pairs}) == len({j for _, j, _ in pairs}) == len(pairs)
    assert matcher.match(plan, drawn.s_graph).status == "unique"  # the map may have more nodes than the plan
    assert matcher.match(drawn.s_graph, plan, start=(0.0, 1e3, 0.0)).status == "none"


def test_shipped_networks_know_the_published_perturbation_and_nothing_of_an_unknown_start(plan: SceneGraph):
    a = laid_out(plan, np.random.default_rng(2))
    drawn = draw(a, "paper", np.random.default_rng(0))
    matcher = PaperMatcher.load("repository")

    def right(s: SceneGraph) -> float:
        result = matcher.match(s, a)
        truth = {**drawn.rooms, **drawn.wall_surfaces}
        return sum(truth.get(i) == j for i, j, _ in (*result.rooms, *result.wall_surfaces)) / len(truth)

    assert right(drawn.s_graph) > 0.75
    assert right(moved(drawn.s_graph, np.array([0.0, 25.0, -20.0]))) < 0.5
    assert load_paper_network("published").settings == PUBLISHED


def test_mistakes_are_refused(tmp_path: Path):
    out = ["--out", str(tmp_path / "out")]
    for wrong in (["--preset", "best"], ["--edges", "all"], ["--without", "walls"], ["--epochs", "0"]):
        with pytest.raises(UserError, match=wrong[0]):
            train_command([*out, *wrong])
    with pytest.raises(UserError, match="cannot be read"):
        Matcher.load("paper", tmp_path / "none.pt")
    (tmp_path / "bad.pt").write_text("no")
    with pytest.raises(UserError, match=r"matching\.published\.train"):
        Matcher.load("paper", tmp_path / "bad.pt")
    with pytest.raises(UserError, match="takes no weights"):
        Matcher.load("voting@repository")
    command = [sys.executable, "-m", "matching.published.train", *out, "--plans", str(tmp_path / "none")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "no such file" in done.stderr and done.stderr.count("\n") == 1


def test_command_trains_goes_on_and_writes_a_card(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    import json

    command = ["--preset", "repository", "--out", str(tmp_path), "--pairs", "20", "--epochs"]
    train_command([*command, "1"])
    train_command([*command, "2"])
    assert "resuming after 1 epochs" in capsys.readouterr().out
    card = json.loads((tmp_path / "model_card.json").read_text())
    assert card["parameters"] == 50_754 and sum(card["pairs"]) == 20
    assert (tmp_path / "curve.csv").read_text().count("\n") == 3
    assert load_paper_network(tmp_path / "paper.pt").settings == REPOSITORY


def test_study_says_what_it_lacks(tmp_path: Path):
    code = (
        "import sys; sys.modules['optuna'] = None; from data.common.cli import run_command; "
        f"from matching.published.study import main; run_command(lambda: main(['--out', {str(tmp_path)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "sgslam[tune]" in done.stderr and done.stderr.count("\n") == 1
