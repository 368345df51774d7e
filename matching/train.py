"""`python -m matching.train`: trains the judge of placements, on maps that are drawn and on maps by SLAM."""

import shlex
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data.common.build import build
from data.common.cli import Parser, run_command
from data.common.cluster import completed
from data.common.errors import UserError
from data.common.files import write_json
from data.plans.sources import Split, split_of

if TYPE_CHECKING:
    from matching.training.judge_data import Examples

PART = 500  # drawn maps of a file
HELD_OUT = 0.15  # drawn maps of the validation split for each one to train with
REPEATED = 2  # times that a map by SLAM counts
EVERY = 500  # steps between checkpoints


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    parser = Parser(
        prog="python -m matching.train",
        description="Train the judge of placements; resume if --out holds a run. Write judge.safetensors and "
        "judge.json.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--maps", type=Path, metavar="DIR", help="maps by SLAM that python -m evaluation.maps wrote")
    parser.add_argument("--drawn", type=int, default=24_000, metavar="N", help="maps to draw (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=8_000, metavar="N", help="steps (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of weights and data (default: %(default)s)")
    parser.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes that draw (default: %(default)s)"
    )
    options = parser.parse_args(given)
    if min(options.drawn, options.steps, options.workers) < 1:
        raise UserError("--drawn, --steps and --workers must be positive")
    try:
        import torch
    except ModuleNotFoundError:
        raise UserError("training needs PyTorch; pip install 'sgslam[torch]'") from None
    from matching.training.judge import JudgeTraining, calibrated, measures, save_judge
    from matching.training.judge_data import Examples

    torch.set_num_threads(1)
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    parts = [drawn(split, options.drawn, options.seed, out, options.workers) for split in ("train", "validation")]
    known = [] if options.maps is None else by_split(options.maps, options.seed, out)
    training = JudgeTraining.begin(options.seed)
    if (out / "checkpoint.pt").exists():
        training.load(out / "checkpoint.pt")
        print(f"resuming after step {training.step}")
    examples = Examples.joined([parts[0], *(known[:1] * REPEATED)])
    for loss in training.train(examples, options.steps, EVERY):
        training.save(out / "checkpoint.pt")
        print(f"step {training.step}  loss {loss:.4f}", flush=True)
    judge = calibrated(training.network, Examples.joined([parts[1], *known[1:2]]))
    save_judge(out / "judge.safetensors", judge)
    of = {"drawn": parts[1], **({"by SLAM": known[1]} if known else {})}
    card = {
        "what": "judges rival placements of a map in a plan",
        "command": f"{parser.prog} {shlex.join(given)}",
        "parameters": sum(value.size for value in judge.weights.values()),
        "maps": {"drawn": len(parts[0]), "by SLAM": len(known[0]) if known else 0},
        "temperature": judge.temperature,
        "validation": {name: measures(training.network, judge, own) for name, own in of.items() if len(own)},
        "sgslam": build(),
    }
    write_json(out / "judge.json", card)
    print(f"wrote {out / 'judge.safetensors'}")
    return 0


def drawn(split: Split, count: int, seed: int, out: Path, workers: int) -> "Examples":
    """The examples of maps drawn from plans of a split; parts that are in the folder already are not drawn again."""
    from matching.training.judge_data import Examples

    count = count if split == "train" else max(1, round(HELD_OUT * count))
    files = {n: out / f"{split}_{seed}_{n}.npz" for n in range(-(-count // PART))}
    missing = [n for n, file in files.items() if not file.exists()]
    work = partial(_draw_part, split, seed, min(PART, count), out)
    for n, done in completed(work, missing, workers):
        if isinstance(done, BaseException):
            raise done
        print(f"drawn: {split} {n + 1} of {len(files)}", flush=True)
    return Examples.joined([Examples.load(file) for file in files.values()])


def _draw_part(split: Split, seed: int, count: int, out: Path, number: int) -> None:
    from matching.training.judge_data import Examples, drawn_examples

    Examples.of(drawn_examples(split, seed, number, count)).save(out / f"{split}_{seed}_{number}.npz")


def by_split(folder: Path, seed: int, out: Path) -> list["Examples"]:
    """The examples of maps in a folder, of the buildings of the splits for training and validation."""
    from matching.training.judge_data import Examples, examples_of_maps

    splits = ("train", "validation")
    files = [out / f"slam_{split}_{seed}.npz" for split in splits]
    if not all(file.exists() for file in files):
        made = list(examples_of_maps(folder, np.random.default_rng(seed)))
        for split, file in zip(splits, files, strict=True):
            Examples.of([e for building, own in made for e in own if split_of(building) == split]).save(file)
    return [Examples.load(file) for file in files]


if __name__ == "__main__":
    run_command(main)
