"""The published methods: what their papers say of them, their training, their answers, their files."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from plans import a_graph, flat, moved

from data import UserError
from data.synthetic_maps.noise_models import draw
from matching import Matcher, MatchResult
from matching.published.data import laid_out
from matching.published.network import PRESETS, PUBLISHED, REPOSITORY, PaperNetwork
from matching.published.train import main as train_command
from matching.published.weights import load_paper_network

PLAN = a_graph(flat(np.random.default_rng(3), 10, 8))


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def right(result: MatchResult, truth: dict[str, str]) -> float:
    return sum(truth.get(i) == j for i, j, _ in (*result.rooms, *result.wall_surfaces)) / len(truth)


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


@pytest.mark.parametrize(("extra", "needs"), [("torch", "torch"), ("tune", "optuna")])
def test_what_is_not_installed_is_named_with_its_extra(
    extra: str, needs: str, tmp_path: Path, monkeypatch: Any
) -> None:
    from matching.published.study import main as tune

    monkeypatch.setitem(sys.modules, needs, None)
    with pytest.raises(UserError, match=rf"pip install 'sgslam\[{extra}\]'"):
        Matcher.load("paper") if needs == "torch" else tune(["--out", str(tmp_path)])
    for method in ("learned", "voting", "combinatorial"):
        Matcher.load(method)
