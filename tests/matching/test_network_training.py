"""Training of the learned proposals: data, learning, resuming, files, mistakes."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import refused
from plans import a_graph, flat

from data import UserError
from data.plans.sources import Plan
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.proposals.network import MatchingNetwork, Settings
from matching.train import batches
from matching.train import main as train_command
from matching.training.data import Drawing, batch_of
from matching.training.export import save_network
from matching.training.trainer import Training, loss, measures, run, train

TINY = Settings(width=16, layers=1, candidates=4, rounds=1, state=16)
GRAPHS = [a_graph(flat(np.random.default_rng(k), 9, 7)) for k in range(3)]
DRAWN = draw(GRAPHS[2], "real", np.random.default_rng(0), 2)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    return Drawing(tuple(Plan(f"p{k}", f"b{k}", g) for k, g in enumerate(GRAPHS)), {}, 5)


@pytest.mark.slow
def test_a_step_has_the_same_batch_whoever_draws_it(drawing: Drawing, scheduler: str) -> None:
    expected = list(islice(batches(drawing, 1, 0), 3))
    for workers, cluster in ((2, None), (1, scheduler)):
        for one, other in zip(expected, batches(drawing, 1, workers, cluster), strict=False):
            assert all(np.array_equal(p.edge, q.edge) for p, q in zip(one.plans, other.plans, strict=True))
            assert all(np.array_equal(p.walls, q.walls) for p, q in zip(one.pairs, other.pairs, strict=True))
    assert not np.array_equal(expected[0].pairs[0].walls, expected[1].pairs[0].walls)
    assert any((pair.walls >= 0).any() for pair in expected[0].pairs)


@pytest.mark.slow
def test_training_goes_on_after_a_kill_as_if_it_had_not_been(drawing: Drawing, tmp_path: Path) -> None:
    watched = {"some": drawing[99]}

    def rows(training: Training) -> Iterator[dict[str, float]]:
        return train(training, batches(drawing, training.step, 0), watched, 4, 2)

    whole = Training.begin(TINY, 0, "cpu")
    assert len(list(rows(whole))) == 2
    killed = Training.begin(TINY, 0, "cpu")
    next(rows(killed))
    killed.save(tmp_path / "checkpoint.pt")
    again = Training.begin(TINY, 1, "cpu")
    again.load(tmp_path / "checkpoint.pt")
    assert len(list(rows(again))) == 1
    assert [r["loss"] for r in again.curve] == [r["loss"] for r in whole.curve]
    for one, other in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(one, other)
    with pytest.raises(UserError, match="of another network"):
        Training.begin(Settings(width=8), 0, "cpu").load(tmp_path / "checkpoint.pt")


def test_a_pair_is_learned_and_the_network_matches(tmp_path: Path) -> None:
    batch = batch_of([(GRAPHS[2], [DRAWN])])
    training = Training.begin(TINY, 0, "cpu")
    losses = [training.learn(batch, 0.0) for _ in range(30)]
    assert losses[-1] < 0.9 * losses[0] and measures(run(training.network, batch))["within"] > 0.5
    save_network(tmp_path, training.average)
    result = Matcher.load(f"learned@{tmp_path / 'learned.onnx'}").match(DRAWN.s_graph, GRAPHS[2])
    assert {s: a for s, a, _ in result.rooms} == dict(DRAWN.rooms)


def test_pairs_of_a_batch_do_not_influence_each_other_but_for_the_reverse_direction() -> None:
    torch.manual_seed(0)
    network = MatchingNetwork(TINY)
    alone, both = batch_of([(GRAPHS[2], [DRAWN])]), batch_of([(GRAPHS[0], []), (GRAPHS[2], [DRAWN])])
    one, other = (run(network, batch) for batch in (alone, both))
    assert torch.equal(one[0].output.walls[-1][1], other[0].output.walls[-1][1])
    assert torch.equal(loss(one), loss(other)) and measures(one) == measures(other)


@pytest.mark.slow
def test_the_command_writes_network_curve_and_card(tmp_path: Path) -> None:
    train_command(["--out", str(tmp_path), "--steps", "1", "--workers", "0"])
    card, curve = json.loads((tmp_path / "model_card.json").read_text()), (tmp_path / "curve.csv").read_text()
    assert card["seed"] == 0 and card["data"]["batches"] == 1 and card["sgslam"]
    assert 0 <= card["held_out"]["walls"] <= 1 and len(curve.splitlines()) == 2
    assert Matcher.load(f"learned@{tmp_path / 'learned.onnx'}").match(DRAWN.s_graph, GRAPHS[2]).reason


@pytest.mark.slow
def test_mistakes_give_one_line(tmp_path: Path) -> None:
    for arguments in (("--plans", tmp_path / "none"), ("--steps", "0")):
        refused("matching.train", "--out", tmp_path / "out", *arguments)
