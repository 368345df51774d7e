"""`python -m matching.train`: trains the network that proposes matches, on plans drawn and read."""

import shlex
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from data.common.build import build
from data.common.cli import Parser, add_workers, run_command
from data.common.cluster import in_order
from data.common.errors import UserError
from data.common.files import write_json
from data.common.processes import end_with_parent

if TYPE_CHECKING:
    from torch.utils.data import Dataset

    from matching.training.data import Batch, Drawing

GENERATED = 180  # seeds of generated plans of each kind
HELD_OUT_SEED = 7
AHEAD = 6  # batches that wait, of each process


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    parser = Parser(
        prog="python -m matching.train",
        description="Train the matching network on generated plans and on the given ones; resume if --out holds a "
        "run. Write learned.onnx, learned.safetensors, curve.csv and model_card.json.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--plans", type=Path, nargs="*", default=[], metavar="PATH", help="plans: files or folders")
    parser.add_argument("--steps", type=int, default=20_000, metavar="N", help="maximum steps (default: 20000)")
    parser.add_argument("--minutes", type=float, default=float("inf"), metavar="M", help="maximum time in minutes")
    parser.add_argument("--every", type=int, default=250, metavar="N", help="steps between evaluations (default: 250)")
    parser.add_argument("--seed", type=int, default=0, help="random seed of weights and data (default: 0)")
    add_workers(parser, "--workers", "number of processes that draw data (default: 1)")
    options = parser.parse_args(given)
    if min(options.steps, options.every) < 1 or not options.minutes > 0 or options.workers < 0:
        raise UserError("--steps, --every and --minutes must be positive, --workers not negative")
    try:
        import torch  # slow to import, as is what follows
    except ModuleNotFoundError:
        raise UserError("training needs PyTorch; pip install 'sgslam[torch]'") from None

    from data.plans import read_plans
    from data.plans.sources import split_of
    from matching.proposals.network import Settings
    from matching.training.data import Drawing, held_out, seeds_of
    from matching.training.export import save_network
    from matching.training.trainer import Training, train, write_curve

    plans = [p for path in options.plans for p in read_plans(path) if p.graph.rooms]  # none of the split "test" is used
    own, others = (tuple(p for p in plans if split_of(p.building) == split) for split in ("train", "validation"))
    drawing = Drawing(own, seeds_of("train", GENERATED), options.seed)
    torch.set_num_threads(1)  # more are slower: the tables of a pair are small
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    training = Training.begin(Settings(), options.seed, "cuda" if torch.cuda.is_available() else "cpu")
    checkpoint = out / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"resuming after step {training.step}")
    stream = batches(drawing, training.step, options.workers, options.scheduler)
    watched = held_out(Drawing(others, seeds_of("validation", GENERATED), HELD_OUT_SEED))
    for row in train(training, stream, watched, options.steps, options.every, options.minutes):
        if row is training.best:
            save_network(out, training.average)
        training.save(checkpoint)
        write_curve(out / "curve.csv", training.curve)
        shown = "  ".join(f"{k} {row[k]:.3f}" for k in ("loss", "surprise", "walls", "rooms", "none", "first"))
        print(f"step {int(row['step'])}  {row['minutes']:.1f} min  {shown}", flush=True)
    named = [
        Path(g).name if Path(g).is_absolute() else g for g in given
    ]  # paths of this machine mean nothing elsewhere
    card = {
        "what": "proposes partners of S wall surfaces in a plan; its answers are to be verified",
        "network": "learned",
        "settings": vars(training.network.settings),
        "parameters": sum(p.numel() for p in training.network.parameters()),
        "command": shlex.join(["python", "-m", "matching.train", *named]),
        "seed": options.seed,
        "data": {
            "generated": f"of each kind the seeds below {GENERATED} that are in the split 'train'",
            "held_out": "the split 'validation' of both; 'test' was not looked at",
            "files": [p.name for p in options.plans],
            "plans": len(own),
            "plans_held_out": len(others),
            "batches": training.step,
        },
        "held_out": training.best,
        "sgslam": build(),
    }
    write_json(out / "model_card.json", card)
    return 0


def batches(drawing: "Drawing", first: int, workers: int, scheduler: str | None = None) -> "Iterator[Batch]":
    """Yields the batches of steps `first`, `first` + 1, ...; they do not depend on who draws them.

    They are drawn ahead by other processes of this machine, by this one if `workers` is 0, or by a Dask cluster.
    Raises what a worker raises, and UserError as `data.common.cluster` does.
    """
    if scheduler is not None:
        return in_order(drawing.__getitem__, count(first), scheduler)
    from torch.utils.data import DataLoader

    options: dict[str, Any] = {"batch_size": None, "sampler": count(first)}
    if workers:
        ahead = {"prefetch_factor": AHEAD, "multiprocessing_context": "spawn", "worker_init_fn": _begin}
        options |= {"num_workers": workers, **ahead}
    return iter(DataLoader(cast("Dataset[Batch]", drawing), **options))


def _begin(_: int) -> None:
    end_with_parent()  # a DataLoader's own workers may wait for a parent that was killed


if __name__ == "__main__":
    run_command(main)
