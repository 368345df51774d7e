"""Training of the learned proposals and their published relatives: data, learning, resuming, mistakes."""

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
from matching.learned.torch_weights import load_network, save_network
from matching.network.dimensions import Settings
from matching.network.registry import KINDS, network_of, settings_of
from matching.training.data import Drawing, batch_of
from matching.training.loss import accuracies, loss, run
from matching.training.stream import batches
from matching.training.trainer import Limits, Training, train

TINY = Settings(width=16, layers=1, candidates=4, cycles=1, rounds=1, state=16)
CPU = torch.device("cpu")
GRAPHS = [a_graph(flat(np.random.default_rng(k), 9, 7)) for k in range(3)]
DRAWN = draw(GRAPHS[2], "real", np.random.default_rng(0), 2)


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    return Drawing(tuple(Plan(f"p{k}", f"b{k}", g) for k, g in enumerate(GRAPHS)), {})


@pytest.mark.slow
def test_a_step_has_the_same_batch_whoever_draws_it(drawing: Drawing, scheduler: str) -> None:
    with batches(drawing, 5, 1, 0) as here:
        expected = [next(here) for _ in range(3)]
    for workers, cluster in ((2, None), (1, scheduler)):
        with batches(drawing, 5, 1, workers, cluster) as there:
            for one, other in zip(expected, (next(there) for _ in range(3)), strict=True):
                assert np.array_equal(one.walls, other.walls) and np.array_equal(one.a.edge, other.a.edge)
    assert not np.array_equal(expected[0].walls, expected[1].walls) and (expected[0].walls >= 0).any()


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

    whole = ran(Training.begin(TINY, 0, CPU))
    with pytest.raises(KeyboardInterrupt):
        ran(Training.begin(TINY, 0, CPU), killed_at=2)
    again = Training.begin(TINY, 1, CPU)
    again.load(tmp_path / "checkpoint.pt")
    ran(again)
    assert [r["loss"] for r in again.curve] == [r["loss"] for r in whole.curve]
    for one, other in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_pair_is_learned_and_its_weights_are_of_one_kind(kind: str, tmp_path: Path) -> None:
    torch.manual_seed(0)
    settings = TINY if kind == "learned" else settings_of(kind)
    network, batch = network_of(settings), batch_of([(GRAPHS[2], [DRAWN])])
    optimizer = torch.optim.AdamW(network.parameters(), 2e-3)
    losses = []
    for _ in range(14):
        value = loss(*run(network, batch, CPU))
        losses.append(value.item())
        optimizer.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 2.0)
        optimizer.step()
    assert losses[-1] < 0.9 * losses[0] and accuracies(*run(network, batch, CPU))["within"][0] > 0.5
    save_network(tmp_path / "n.pt", network)
    if kind == "learned":
        result = Matcher.load("learned", tmp_path / "n.pt").match(DRAWN.s_graph, GRAPHS[2])
        assert result.status in ("unique", "ambiguous", "none")
    with pytest.raises(UserError, match="version"):
        load_network(tmp_path / "n.pt", next(other for other in KINDS if other != kind))


@pytest.mark.slow
def test_mistakes_give_one_line(tmp_path: Path) -> None:
    for arguments in (("--plans", tmp_path / "none"), ("--device", "abacus"), ("--steps", "0")):
        refused("matching.train", "--out", tmp_path / "out", *arguments)
