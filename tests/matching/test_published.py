"""The published matcher: what its paper says of it, its training, its answers, its files."""

import csv
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import torch
from plans import a_graph, flat, moved

import matching
from data import UserError
from data.synthetic_maps.noise_models import draw
from matching import Matcher, MatchResult
from matching.published.matcher import load_paper_network
from matching.published.network import PRESETS, PaperNetwork, soft_assignment
from matching.published.train import main as train_command
from matching.published.trainer import laid_out

PLAN = a_graph(flat(np.random.default_rng(3), 10, 8))


def right(result: MatchResult, truth: dict[str, str]) -> float:
    return sum(truth.get(i) == j for i, j, _ in (*result.rooms, *result.wall_surfaces)) / len(truth)


def test_the_published_network_knows_its_perturbation_and_nothing_of_an_unknown_start() -> None:
    a = laid_out(PLAN, np.random.default_rng(2))
    drawn = draw(a, "paper", np.random.default_rng(0))
    matcher, truth = Matcher.load("paper@repository"), {**drawn.rooms, **drawn.wall_surfaces}
    assert right(matcher.match(drawn.s_graph, a), truth) > 0.75
    assert right(matcher.match(moved(drawn.s_graph, 0.0, 25.0, -20.0), a), truth) < 0.5
    assert matcher.match(drawn.s_graph, a, start=(0.0, 1e3, 0.0)).status == "none"
    assert load_paper_network("published").settings == PRESETS["published"]
    sizes = {name: sum(p.numel() for p in PaperNetwork(s).parameters()) for name, s in PRESETS.items()}
    assert sizes == {"published": 55_074, "repository": 50_754}


def test_sinkhorn_equals_that_of_a_square_matrix_filled_with_dummies() -> None:
    for shape in ((5, 3), (3, 5), (4, 4)):
        affinity = torch.randn(*shape, generator=torch.Generator().manual_seed(0))
        size = max(shape)
        square = torch.nn.functional.pad(affinity, (0, size - shape[1], 0, size - shape[0]))
        p = (square.double() / 0.3).exp()
        for k in range(10):
            p = p / p.sum(dim=(k + (shape[0] < shape[1])) % 2, keepdim=True)
        assert torch.allclose(soft_assignment(affinity, 0.3, 10), p[: shape[0], : shape[1]].float(), atol=1e-6)


def test_training_learns_and_the_same_seed_gives_the_same_file(tmp_path: Path) -> None:
    given = ["--preset", "repository", "--pairs", "12", "--epochs", "3", "--out"]
    for name in ("one", "two"):
        train_command([*given, str(tmp_path / name)])
    one, two = ((tmp_path / name / "paper.safetensors").read_bytes() for name in ("one", "two"))
    assert one == two
    with (tmp_path / "one/curve.csv").open() as file:
        losses = [float(row["loss"]) for row in csv.DictReader(file)]
    assert len(losses) == 3 and losses[-1] < losses[0]
    assert load_paper_network(tmp_path / "one/paper.safetensors").settings == PRESETS["repository"]
    Matcher.load(f"paper@{tmp_path}/one/paper.safetensors").match(PLAN, PLAN)
    card = json.loads((tmp_path / "one/model_card.json").read_text())
    assert card["data"]["files"] == [] and sum(card["data"]["pairs"]) == 12  # the form that evaluations read


def test_mistakes_are_named(tmp_path: Path) -> None:
    for wrong in (["--preset", "best"], ["--epochs", "0"], ["--pairs", "0"]):
        with pytest.raises(UserError, match=wrong[0]):
            train_command(["--out", str(tmp_path / "out"), *wrong])
    shipped = (Path(matching.__file__).parent / "weights/paper_published.safetensors").read_bytes()
    (tmp_path / "text.safetensors").write_text("no")
    (tmp_path / "short.safetensors").write_bytes(shipped[:-4])
    (tmp_path / "other.safetensors").write_bytes(safetensors.torch.save({"a": torch.zeros(1)}))
    wider = shipped[8:].replace(b'\\"hidden\\": 64', b'\\"hidden\\": 65')
    assert wider != shipped[8:]
    (tmp_path / "wider.safetensors").write_bytes(shipped[:8] + wider)
    for name in ("text", "short", "other", "wider", "none"):
        with pytest.raises(UserError, match=f"{name}.safetensors"):
            Matcher.load(f"paper@{tmp_path}/{name}.safetensors")
    with pytest.raises(UserError, match=tmp_path.name):
        Matcher.load(f"paper@{tmp_path}")


def test_what_is_not_installed_is_named_with_its_extra(tmp_path: Path, monkeypatch: Any) -> None:
    for name in [m for m in sys.modules if m.startswith("matching.published.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    for call in (partial(Matcher.load, "paper"), partial(train_command, ["--out", str(tmp_path)])):
        with pytest.raises(UserError, match=r"torch; pip install 'sgslam\[torch\]'"):
            call()
    for method in ("learned", "voting", "combinatorial"):
        Matcher.load(method)
