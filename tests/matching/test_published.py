"""The published methods: what their papers say of them, their training, their answers, their files."""

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from methods import as_map
from plans import a_graph, box, flat, moved

from data import SceneGraph, UserError, WallSurface
from data.synthetic_maps.noise_models import draw
from matching import Matcher, MatchResult
from matching.combinatorial import DEVELOP, CombinatorialMatcher
from matching.published.data import PaperSplit, drawn_pairs, laid_out
from matching.published.graph import paper_graph
from matching.published.network import PRESETS, PUBLISHED, REPOSITORY, Nodes, PaperNetwork
from matching.published.train import main as train_command
from matching.published.trainer import PaperTraining, Recipe, train
from matching.published.weights import load_paper_network

PLAN = a_graph(flat(np.random.default_rng(3), 10, 8))
TINY = dataclasses.replace(REPOSITORY, hidden=16, out=8)
RELEASED, LATER = Matcher.load("combinatorial"), Matcher.load("combinatorial-grid")


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def right(result: MatchResult, truth: dict[str, str]) -> float:
    return sum(truth.get(i) == j for i, j, _ in (*result.rooms, *result.wall_surfaces)) / len(truth)


@pytest.mark.parametrize("method", ["pca-gm", "superglue"])
def test_relatives_of_our_network_find_most_walls_of_a_map(method: str) -> None:
    plan, shares = a_graph(flat(np.random.default_rng(1), 12, 9)), []
    for seed in range(3):
        drawn = draw(plan, "real", np.random.default_rng(seed), 6)
        result = Matcher.load(method).match(drawn.s_graph, plan)
        shares.append(right(dataclasses.replace(result, rooms=()), drawn.wall_surfaces))
        assert len({a for _, a, _ in result.wall_surfaces}) == len(result.wall_surfaces)
    assert np.mean(shares) > 0.5
    walls = tuple(dataclasses.replace(w, room=None) for w in drawn.s_graph.wall_surfaces)
    assert Matcher.load(method).match(SceneGraph("map", (), walls), plan).rooms == ()


def test_the_published_networks_know_their_perturbation_and_nothing_of_an_unknown_start() -> None:
    a = laid_out(PLAN, np.random.default_rng(2))
    drawn = draw(a, "paper", np.random.default_rng(0))
    matcher, truth = Matcher.load("paper@repository"), {**drawn.rooms, **drawn.wall_surfaces}
    assert right(matcher.match(drawn.s_graph, a), truth) > 0.75
    assert right(matcher.match(moved(drawn.s_graph, 0.0, 25.0, -20.0), a), truth) < 0.5
    assert matcher.match(drawn.s_graph, a, start=(0.0, 1e3, 0.0)).status == "none"
    assert load_paper_network("published").settings == PUBLISHED
    sizes = {name: sum(p.numel() for p in PaperNetwork(s).parameters()) for name, s in PRESETS.items()}
    assert sizes == {"published": 55_074, "repository": 50_754}


def test_training_lowers_the_loss_and_goes_on_bitwise(tmp_path: Path) -> None:
    pairs = drawn_pairs(11, 0, [], TINY)
    parts = PaperSplit(tuple(pairs[:8]), tuple(pairs[8:]), ())
    recipe = Recipe(rate=3e-3, batch=4)

    def begun(epochs: int) -> PaperTraining:
        return PaperTraining.begin(TINY, dataclasses.replace(recipe, epochs=epochs), parts, 0)

    whole, half, again = begun(4), begun(2), begun(4)
    train(whole, parts, lambda row: None)
    train(half, parts, lambda row: None)
    half.save(tmp_path / "checkpoint.pt")
    again.load(tmp_path / "checkpoint.pt")
    train(again, parts, lambda row: None)
    assert [r["loss"] for r in again.curve] == [r["loss"] for r in whole.curve]
    assert whole.curve[-1]["loss"] < 0.97 * whole.curve[0]["loss"]
    with pytest.raises(UserError, match="another settings"):
        PaperTraining.begin(PUBLISHED, recipe, parts, 0).load(tmp_path / "checkpoint.pt")
    still = PaperTraining.begin(TINY, Recipe(rate=0.0, decay=0.0, batch=4, patience=2), parts, 0)
    train(still, parts, lambda row: None)
    assert len(still.curve) == 3
    a, s = (paper_graph(g) for g in (PLAN, draw(PLAN, "paper", np.random.default_rng(0)).s_graph))
    network = whole.best_network()
    alone, batched = network(Nodes.of([a]), Nodes.of([s])), network(Nodes.of([a, a]), Nodes.of([s, s]))
    assert all(torch.allclose(alone[0], soft, atol=1e-6) for soft in batched)


@pytest.mark.slow
def test_the_command_trains_and_refuses_mistakes(tmp_path: Path) -> None:
    train_command(["--preset", "repository", "--out", str(tmp_path), "--pairs", "20", "--epochs", "1"])
    assert json.loads((tmp_path / "model_card.json").read_text())["parameters"] == 50_754
    assert load_paper_network(tmp_path / "paper.pt").settings == REPOSITORY
    for wrong in (["--preset", "best"], ["--edges", "all"], ["--without", "walls"], ["--epochs", "0"]):
        with pytest.raises(UserError, match=wrong[0]):
            train_command(["--out", str(tmp_path / "out"), *wrong])
    (tmp_path / "bad.pt").write_text("no")
    for name in ("bad.pt", "none.pt"):
        with pytest.raises(UserError, match=name):
            Matcher.load("paper", tmp_path / name)


def tied(result: MatchResult) -> int:
    return {"none": 0, "unique": 1}.get(result.status) or int(result.reason.split()[0])


L_SHAPE = [box(0, 0, 5, 3), box(5.2, 0, 3, 4), box(0, 3.2, 3.5, 4.5)]


def test_the_search_ties_on_equal_squares_and_ends_at_one_spurious_wall() -> None:
    squares = a_graph([box(0, 0, 4, 4), box(4.2, 0, 4, 4)])
    assert tied(RELEASED.match(as_map(squares), squares)) == 4 and tied(LATER.match(as_map(squares), squares)) == 1
    plan = a_graph([*L_SHAPE, box(8.4, 0, 6, 2.5)])
    s = as_map(a_graph(L_SHAPE))
    extra = dataclasses.replace(s, wall_surfaces=(*s.wall_surfaces, WallSurface("x", "room0", (3, 1), (1, 0), 1.0)))
    fewer = dataclasses.replace(s, wall_surfaces=s.wall_surfaces[1:])
    for matcher in (RELEASED, LATER):
        assert matcher.match(s, plan).status == matcher.match(fewer, plan).status == "unique"
        assert matcher.match(extra, plan).status == matcher.match(as_map(plan), a_graph(L_SHAPE)).status == "none"
    for other in (moved(s, 0, 0, 0, mirror=True), moved(s, np.pi / 2, 0, 0)):
        assert RELEASED.match(other, plan).status == "unique" and LATER.match(other, plan).status == "none"
    assert RELEASED.match(s, plan, start=(0.0, 9.0, 0.0)).status == "none"


def test_the_search_stops_at_its_limit_of_time() -> None:
    plan = a_graph([box(5.0 * x, 5.0 * y, 4, 4) for x in range(15) for y in range(15)])
    result = CombinatorialMatcher(dataclasses.replace(DEVELOP, limit_s=0.3)).match(as_map(plan), plan)
    assert result.status == "none" and "0.3 s" in result.reason


@pytest.mark.parametrize(("extra", "needs"), [("torch", "torch"), ("tune", "optuna")])
def test_what_is_not_installed_is_named_with_its_extra(
    extra: str, needs: str, tmp_path: Path, monkeypatch: Any
) -> None:
    from matching.published.study import main as tune

    monkeypatch.setitem(sys.modules, needs, None)
    with pytest.raises(UserError, match=rf"pip install 'sgslam\[{extra}\]'"):
        Matcher.load("pca-gm") if needs == "torch" else tune(["--out", str(tmp_path)])
    for method in ("learned", "voting", "combinatorial"):
        Matcher.load(method)
