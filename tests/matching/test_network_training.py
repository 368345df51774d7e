"""Training: the same data for the same seed, going on after a kill, the command."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import refused
from plans import a_graph, flat

from data.plans.sources import Plan
from matching.network.dimensions import Settings
from matching.training.data import Drawing
from matching.training.stream import batches
from matching.training.trainer import Limits, Training, train

pytestmark = pytest.mark.slow

TINY = Settings(width=16, layers=1, candidates=4, cycles=1, rounds=1, state=16)
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    graphs = [a_graph(flat(np.random.default_rng(k), 9, 7)) for k in range(3)]
    return Drawing(tuple(Plan(f"p{k}", f"b{k}", g) for k, g in enumerate(graphs)), {})


def test_a_step_has_the_same_batch_whoever_draws_it(drawing: Drawing, scheduler: str):
    with batches(drawing, 5, 1, 0) as here:
        expected = [next(here) for _ in range(3)]
    for workers, cluster in ((2, None), (1, scheduler)):
        with batches(drawing, 5, 1, workers, cluster) as there:
            found = [next(there) for _ in range(3)]
        for one, other in zip(expected, found, strict=True):
            assert one.s.walls == other.s.walls and np.array_equal(one.walls, other.walls)
            assert np.array_equal(one.a.edge, other.a.edge)
    assert not np.array_equal(expected[0].walls, expected[1].walls)
    assert (expected[0].walls >= 0).any()


def test_a_run_that_was_stopped_goes_on_as_if_it_had_not_been(drawing: Drawing, tmp_path: Path):
    torch.set_num_threads(1)
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


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "matching.train", *arguments], capture_output=True, text=True, timeout=120
    )  # fmt: skip


def test_help_does_not_load_torch():
    code = "import sys, matching, matching.train\ntry:\n matching.train.main(['--help'])\nexcept SystemExit: pass\n"
    code += "assert 'torch' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60).returncode == 0


def test_mistakes_give_one_line(tmp_path: Path):
    for arguments in (("--plans", tmp_path / "none"), ("--device", "abacus")):
        refused("matching.train", "--out", tmp_path / "out", *arguments)
    done = command("--out", str(tmp_path / "out"), "--steps", "0")
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
