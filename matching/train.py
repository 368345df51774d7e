"""`python -m matching.train`: trains the network that proposes matches, on plans drawn and read."""

import shlex
import sys
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, add_workers, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    from data.plans.sources import Plan
    from matching.training.trainer import Training

GENERATED = 180  # seeds of generated plans of each kind
HELD_OUT_SEED = 7
DEVICES = ("auto", "cpu", "cuda")


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(given)
    if min(options.steps, options.every) < 1 or not options.minutes > 0 or options.workers < 0:
        raise UserError("--steps, --every and --minutes must be positive, --workers not negative")
    if options.device not in DEVICES:
        raise UserError(f"--device {options.device}: give one of {', '.join(DEVICES)}")
    try:
        import torch  # slow to import, as is what follows
    except ModuleNotFoundError:
        raise UserError("training needs PyTorch; pip install 'sgslam[torch]'") from None
    own, others = _split(options.plans)

    from matching.proposals.network import Settings
    from matching.training.data import Drawing, held_out, seeds_of
    from matching.training.export import save_network
    from matching.training.report import write_card, write_curve
    from matching.training.stream import batches
    from matching.training.trainer import Limits, Row, Training, train

    if options.device == "cuda" and not torch.cuda.is_available():
        raise UserError("--device cuda: no GPU that torch can use; leave it out to train on the processor")
    device = "cuda" if options.device != "cpu" and torch.cuda.is_available() else "cpu"
    torch.set_num_threads(1)  # more are slower: the tables of a pair are small
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    drawing = Drawing(tuple(own), seeds_of("train", GENERATED))
    training = Training.begin(Settings(), options.seed, device)
    checkpoint = out / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"resuming after step {training.step}")

    def on_evaluation(row: Row) -> None:
        training.save(checkpoint)
        save_network(out, training.best_network())
        write_curve(out, training.curve)
        shown = "  ".join(f"{k} {row[k]:.3f}" for k in ("loss", "surprise", "walls", "rooms", "none", "first"))
        print(f"step {int(row['step'])}  {row['minutes']:.1f} min  {shown}", flush=True)

    limits = Limits(options.steps, options.minutes, options.every)
    with batches(drawing, options.seed, training.step, options.workers, options.scheduler) as stream:
        watched = held_out(Drawing(tuple(others), seeds_of("validation", GENERATED)), HELD_OUT_SEED)
        ended = train(training, stream, watched, limits, on_evaluation)
    print(ended)
    data = {"plans": len(own), "plans_held_out": len(others), "batches": training.step}
    write_card(out, {**_card(options, given, training), "ended": ended, "data": _data(options) | data})
    return 0


def _card(options: Namespace, given: list[str], training: "Training") -> dict[str, Any]:
    """The model card's entries on the network and the run."""
    named = [
        Path(g).name if Path(g).is_absolute() else g for g in given
    ]  # paths of this machine mean nothing elsewhere
    return {
        "what": "proposes partners of S wall surfaces in a plan; its answers are to be verified",
        "network": "learned",
        "settings": vars(training.network.settings),
        "parameters": sum(p.numel() for p in training.network.parameters()),
        "command": shlex.join(["python", "-m", "matching.train", *named]),
        "seed": options.seed,
        "held_out": min(training.curve, key=lambda row: row["surprise"]),
    }


def _data(options: Namespace) -> dict[str, Any]:
    return {
        "generated": f"of each kind the seeds below {GENERATED} that are in the split 'train'",
        "held_out": "the split 'validation' of both; 'test' was not looked at",
        "files": [p.name for p in options.plans],
    }


def _parser() -> Parser:
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
    parser.add_argument("--device", default="auto", help="cpu, cuda, or auto (default): a GPU if there is one")
    return parser


def _split(paths: list[Path]) -> tuple[list["Plan"], list["Plan"]]:
    """The files' plans for training and validation, split by building; test buildings are in neither."""
    from data.plans import read_plans
    from data.plans.splits import split_of

    plans = [p for path in paths for p in read_plans(path) if p.graph.rooms]
    own = [p for p in plans if split_of(p.building) == "train"]
    return own, [p for p in plans if split_of(p.building) == "validation"]


if __name__ == "__main__":
    run_command(main)
