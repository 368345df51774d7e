"""`python -m matching.published.train`: trains the published matcher, or a variant without one of its parts."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from matching.published.graph import EDGES, WITHOUT
from matching.torch_extra import need_torch

if TYPE_CHECKING:
    from data.plans.sources import Plan

COMMAND = "python -m matching.published.train"
PRESETS = ("published", "repository")


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(given)
    _check(options.preset, "--preset", PRESETS)
    _check(options.edges, "--edges", EDGES)
    for part in options.without:
        _check(part, "--without", WITHOUT)
    if min(options.pairs, options.epochs, options.patience) < 1 or not options.minutes > 0:
        raise UserError("--pairs, --epochs, --patience and --minutes must be positive")
    need_torch("training")
    plans = read_raw(options.plans)

    from dataclasses import replace

    from matching.published.data import drawn_pairs, split
    from matching.published.network import PRESETS as SETTINGS
    from matching.published.trainer import RECIPES, PaperTraining, Row, evaluate, train
    from matching.published.weights import save_paper_network
    from matching.training.report import write_card, write_curve

    settings = replace(SETTINGS[options.preset], edges=options.edges, without=tuple(options.without))
    recipe = replace(RECIPES[options.preset], epochs=options.epochs, patience=options.patience)
    pairs = split(drawn_pairs(options.pairs, options.seed, plans, settings), options.seed)
    training = PaperTraining.begin(settings, recipe, pairs, options.seed)
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    checkpoint = out / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"resuming after {len(training.curve)} epochs")

    def on_evaluation(row: Row) -> None:
        training.save(checkpoint)
        save_paper_network(out / "paper.pt", training.best_network())
        write_curve(out, training.curve)
        print("  ".join(f"{k} {v:.4g}" for k, v in row.items()), flush=True)

    ended = train(training, pairs, on_evaluation, options.minutes)
    print(ended)
    network = training.best_network()
    loss, accuracy = evaluate(network, pairs.test)
    write_card(out, {
        **_card(given, options, len(plans)), "ended": ended, "settings": settings.to_dict(),
        "recipe": recipe.to_dict(), "parameters": sum(p.numel() for p in network.parameters()),
        "pairs": [len(part) for part in (pairs.train, pairs.validation, pairs.test)],
        "best": min(training.curve, key=lambda row: row["validation loss"]),
        "test": {"loss": loss, "accuracy": accuracy},
    })  # fmt: skip
    print(f"test set: loss {loss:.4f}, accuracy {accuracy:.4f}")
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog=COMMAND,
        description="Train the published matcher on pairs with the published perturbation; resume if --out holds "
        "a run. Write paper.pt, curve.csv and model_card.json.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--preset", default="published", help="hyper-parameters: published (default) or repository")
    parser.add_argument("--edges", default="paper", help="edges as in the paper (default) or in its code: paper, code")
    parser.add_argument("--without", nargs="+", default=[], metavar="PART", help=f"leave out: {', '.join(WITHOUT)}")
    add_data_options(parser)
    parser.add_argument("--epochs", type=int, default=60, metavar="N", help="maximum epochs (default: 60)")
    parser.add_argument("--patience", type=int, default=20, metavar="N", help="epochs without progress (default: 20)")
    parser.add_argument("--minutes", type=float, default=float("inf"), metavar="M", help="maximum time in minutes")
    return parser


def _card(given: list[str], options: Any, plans: int) -> dict[str, Any]:
    """The model card's entries on the run and its data."""
    return {
        "what": "the published matcher, reproduced: answers without a check of its own",
        "command": shlex.join([*COMMAND.split(), *map(_named, given)]), "seed": options.seed,
        "data": {
            "files": [p.name for p in options.plans], "plans": plans,
            "split": "70 / 15 / 15 % by building, stratified by size",
        },
    }  # fmt: skip


def add_data_options(parser: Parser) -> None:
    """Adds the options for the data that pairs are drawn from."""
    parser.add_argument("--plans", type=Path, nargs="*", default=[], metavar="PATH", help="plans: files or folders")
    parser.add_argument("--pairs", type=int, default=2000, metavar="N", help="pairs of graphs (default: 2000)")
    parser.add_argument("--seed", type=int, default=0, help="random seed of weights and data (default: 0)")


def read_raw(paths: list[Path]) -> list["Plan"]:
    """Reads plans with every edge of a room as a surface, as in the published data."""
    from data.plans import read_plans

    plans = [p for path in paths for p in read_plans(path, merge_collinear=False) if p.graph.rooms]
    return [p for p in plans if p.graph.wall_surfaces]


def _check(value: str, option: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise UserError(f"{option} {value}: give one of {', '.join(known)}")


def _named(argument: str) -> str:
    """Shortens absolute paths to names, since paths of this machine mean nothing elsewhere."""
    return Path(argument).name if Path(argument).is_absolute() else argument


if __name__ == "__main__":
    run_command(main)
