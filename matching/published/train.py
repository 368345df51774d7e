"""`python -m matching.published.train`: trains the published matcher."""

import shlex
import sys
from dataclasses import asdict
from pathlib import Path

from data.common.build import build
from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_json


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    parser = Parser(
        prog="python -m matching.published.train",
        description="Train the published matcher on pairs with the published perturbation. Write paper.safetensors "
        "(the best network so far), curve.csv and model_card.json.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--preset", default="published", help="hyper-parameters: published (default) or repository")
    parser.add_argument("--plans", type=Path, nargs="*", default=[], metavar="PATH", help="plans: files or folders")
    parser.add_argument("--pairs", type=int, default=2000, metavar="N", help="pairs of graphs (default: 2000)")
    parser.add_argument("--epochs", type=int, default=60, metavar="N", help="maximum epochs (default: 60)")
    parser.add_argument("--seed", type=int, default=0, help="random seed of weights and data (default: 0)")
    options = parser.parse_args(given)
    if min(options.pairs, options.epochs) < 1:
        raise UserError("--pairs and --epochs must be positive")
    try:
        from matching.published.matcher import save_paper_network
        from matching.published.network import PRESETS
        from matching.published.trainer import drawn_pairs, evaluate, train, write_curve
    except ModuleNotFoundError as error:
        raise UserError(f"training needs {error.name}; pip install 'sgslam[torch]'") from None
    from data.plans import read_plans
    from data.plans.bim import SHARES, split_of

    if options.preset not in PRESETS:
        raise UserError(f"--preset {options.preset}: give one of {', '.join(PRESETS)}")
    # every edge of a room is a surface, as in the published data
    plans = [p for path in options.plans for p in read_plans(path, merge_collinear=False)]
    plans = [p for p in plans if p.graph.rooms and p.graph.wall_surfaces]
    pairs = [(split_of(pair.building), pair) for pair in drawn_pairs(options.pairs, options.seed, plans)]
    training, validation, test = ([pair for of, pair in pairs if of == split] for split in SHARES)
    if not training:
        raise UserError(f"--pairs {options.pairs}: none of them is for training; give a larger number")
    options.out.mkdir(parents=True, exist_ok=True)
    for network, curve in train(PRESETS[options.preset], training, validation, options.seed, options.epochs):
        save_paper_network(options.out / "paper.safetensors", network)
        write_curve(options.out / "curve.csv", curve)
        print("  ".join(f"{k} {v:.4g}" for k, v in curve[-1].items()), flush=True)
    loss, accuracy = evaluate(network, test)
    card = {
        "command": f"{parser.prog} {shlex.join(given)}",
        "settings": asdict(network.settings),
        "parameters": sum(p.numel() for p in network.parameters()),
        "data": {
            "files": [p.name for p in options.plans],
            "plans": len(plans),
            "pairs": [len(part) for part in (training, validation, test)],
            "split": "70 / 15 / 15 % by building",
        },
        "best": min(curve, key=lambda row: row["validation loss"]),
        "test": {"loss": loss, "accuracy": accuracy},
        "sgslam": build(),
    }
    write_json(options.out / "model_card.json", card)
    print(f"test set: loss {loss:.4f}, accuracy {accuracy:.4f}")
    return 0


if __name__ == "__main__":
    run_command(main)
