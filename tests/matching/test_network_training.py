"""Training of the learned proposals: data, learning, resuming, files, mistakes."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import refused
from plans import a_graph, flat

from data.plans.sources import Plan
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.proposals.network import MatchingNetwork, Settings
from matching.training.data import Drawing, batch_of
from matching.training.export import save_network
from matching.training.loss import loss, measures, run
from matching.training.report import write_card
from matching.training.stream import batches
from matching.training.trainer import Limits, Training, train

TINY = Settings(width=16, layers=1, candidates=4, rounds=1, state=16)
GRAPHS = [a_graph(flat(np.random.default_rng(k), 9, 7)) for k in range(3)]
DRAWN = draw(GRAPHS[2], "real", np.random.default_rng(0), 2)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    return Drawing(tuple(Plan(f"p{k}", f"b{k}", g) for k, g in enumerate(GRAPHS)), {})


@pytest.mark.slow
def test_a_step_has_the_same_batch_whoever_draws_it(drawing: Drawing, scheduler: str) -> None:
    with batches(drawing, 5, 1, 0) as here:
        expected = [next(here) for _ in range(3)]
    for workers, cluster in ((2, None), (1, scheduler)):
        with batches(drawing, 5, 1, workers, cluster) as there:
            for one in expected:
                other = next(there)
                assert all(np.array_equal(p.edge, q.edge) for p, q in zip(one.plans, other.plans, strict=True))
                assert all(np.array_equal(p.walls, q.walls) for p, q in zip(one.pairs, other.pairs, strict=True))
    assert not np.array_equal(expected[0].pairs[0].walls, expected[1].pairs[0].walls)
    assert any((pair.walls >= 0).any() for pair in expected[0].pairs)


@pytest.mark.slow
def test_training_goes_on_after_a_kill_as_if_it_had_not_been(drawing: Drawing, tmp_path: Path) -> None:
    watched = {"some": drawing.batch(99, 0)}

    def ran(training: Training, killed_at: int | None = None) -> Training:
        def on_evaluation(row: dict[str, float]) -> None:
            if row["step"] == killed_at:
                training.save(tmp_path / "checkpoint.pt")
                raise KeyboardInterrupt

        with batches(drawing, 0, training.step, 0) as stream:
            train(training, stream, watched, Limits(4, every=2, patience=9), on_evaluation)
        return training

    whole = ran(Training.begin(TINY, 0, "cpu"))
    with pytest.raises(KeyboardInterrupt):
        ran(Training.begin(TINY, 0, "cpu"), killed_at=2)
    again = Training.begin(TINY, 1, "cpu")
    again.load(tmp_path / "checkpoint.pt")
    ran(again)
    assert [r["loss"] for r in again.curve] == [r["loss"] for r in whole.curve]
    for one, other in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(one, other)


def test_a_pair_is_learned_and_the_network_matches(tmp_path: Path) -> None:
    batch = batch_of([(GRAPHS[2], [DRAWN])])
    training = Training.begin(TINY, 0, "cpu")
    losses = [training.learn(batch, 0.0) for _ in range(30)]
    assert losses[-1] < 0.9 * losses[0] and measures(run(training.network, batch))["within"] > 0.5
    save_network(tmp_path, training.best_network())
    result = Matcher.load(f"learned@{tmp_path / 'learned.onnx'}").match(DRAWN.s_graph, GRAPHS[2])
    assert result.status in ("unique", "ambiguous", "none")


def test_pairs_of_a_batch_do_not_influence_each_other_but_for_the_reverse_direction() -> None:
    torch.manual_seed(0)
    network = MatchingNetwork(TINY)
    alone, both = batch_of([(GRAPHS[2], [DRAWN])]), batch_of([(GRAPHS[0], []), (GRAPHS[2], [DRAWN])])
    one, other = (run(network, batch) for batch in (alone, both))
    assert torch.equal(one[0].output.walls[-1][1], other[0].output.walls[-1][1])
    assert torch.equal(loss(one), loss(other)) and measures(one) == measures(other)


def test_the_card_is_beside_the_weights(tmp_path: Path) -> None:
    write_card(tmp_path, {"seed": 3})
    card = json.loads((tmp_path / "model_card.json").read_text())
    assert card["seed"] == 3 and "commit" in card


@pytest.mark.slow
def test_mistakes_give_one_line(tmp_path: Path) -> None:
    for arguments in (("--plans", tmp_path / "none"), ("--device", "abacus"), ("--steps", "0")):
        refused("matching.train", "--out", tmp_path / "out", *arguments)
