"""`python -m matching.train`: trains the judge of placements, on maps that are drawn and on maps by SLAM."""

import shlex
import sys
import zlib
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data.common.build import build
from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_json
from data.common.processes import completed
from data.plans.bim import Split, split_of

if TYPE_CHECKING:
    from matching.training.judge_data import Examples

PART = 500  # drawn maps of a file
NETWORKS = 3  # each is trained without a share of the buildings, which say how well it is calibrated
HELD_OUT = 0.15  # drawn maps of the validation split for each one to train with
REPEATED = 3  # times that a map by SLAM counts: about as much as those that are drawn
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
    parser.add_argument("--drawn", type=int, default=9_000, metavar="N", help="maps to draw (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=3_000, metavar="N", help="of each network (default: %(default)s)")
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
    from matching.training.judge import JudgeTraining, judge_of, log_odds_of, measures, save_judge
    from matching.training.judge_data import Examples

    torch.set_num_threads(1)
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    parts = [drawn(split, options.drawn, options.seed, out, options.workers) for split in ("train", "validation")]
    known = {} if options.maps is None else by_building(options.maps, options.seed, out)
    folds = [
        Examples.joined([Examples.of([]), *(e for name, e in known.items() if fold_of(name) == k)])
        for k in range(NETWORKS)
    ]
    networks = []
    for k in range(NETWORKS):
        training, checkpoint = JudgeTraining.begin(NETWORKS * options.seed + k), out / f"checkpoint_{k}.pt"
        if checkpoint.exists():
            training.load(checkpoint)
            print(f"network {k + 1}: resuming after step {training.step}")
        others = [e for n, e in enumerate(folds) if n != k]
        examples = Examples.joined([parts[0], *(others * REPEATED)])
        for loss in training.train(examples, options.steps, EVERY):
            training.save(checkpoint)
            print(f"network {k + 1}  step {training.step}  loss {loss:.4f}", flush=True)
        networks.append(training.network)
    judge = judge_of(networks)
    save_judge(out / "judge.safetensors", judge)
    seen = {"drawn": (log_odds_of(judge, parts[1]), parts[1])}
    if known:
        # of each building by the network that has not seen it
        each = [log_odds_of(judge_of([one]), fold) for one, fold in zip(networks, folds, strict=True) if len(fold)]
        seen["by SLAM, by one network"] = torch.cat(each), Examples.joined(folds)
    card = {
        "what": "judges rival placements of a map in a plan",
        "command": f"{parser.prog} {shlex.join(given)}",
        "parameters": sum(value.size for value in judge.weights.values()),
        "maps": {"drawn": len(parts[0]), "by SLAM": sum(map(len, folds)), "buildings": len(known)},
        "validation": {name: measures(*of) for name, of in seen.items()},
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


def by_building(folder: Path, seed: int, out: Path) -> dict[str, "Examples"]:
    """The examples of the maps of each building in a folder, but those of the test split."""
    from matching.training.judge_data import Examples, examples_of_maps

    file = out / f"slam_{seed}.npz"
    if not file.exists():
        Examples.of([e for _, e in examples_of_maps(folder, np.random.default_rng(seed))]).save(file)
    every = Examples.load(file)
    building = np.array([about.split()[1] for about in every.about])
    return {
        str(name): every[np.flatnonzero(building == name)] for name in np.unique(building) if split_of(name) != "test"
    }


def fold_of(building: str) -> int:
    """Which of the networks does not see a building; the same on every machine."""
    return zlib.crc32(building.encode()) % NETWORKS


if __name__ == "__main__":
    run_command(main)
