"""`python -m matching.published.study`: searches hyper-parameters of the published matcher, as its authors did.

Optuna's TPE sampler with the median pruner over the space of the public code; the objective is the validation loss.
(The loss depends on the temperature, which is searched too, so a lower loss is not always a better matching; every
trial's accuracy is stored as well.)
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from matching.published.train import add_data_options, read_raw

if TYPE_CHECKING:
    from matching.published.data import PaperSplit
    from matching.published.network import PaperSettings
    from matching.published.trainer import Recipe

STUDY = "published matcher"
PATIENCE = 5  # epochs of a trial without a better one


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(
        prog="python -m matching.published.study",
        description="Search hyper-parameters of the published matcher (Optuna, TPE); resume if --out holds a study. "
        "Write study.log and best.json.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the study")
    add_data_options(parser)
    parser.add_argument("--trials", type=int, default=30, metavar="N", help="total number of trials (default: 30)")
    parser.add_argument("--epochs", type=int, default=30, metavar="N", help="epochs per trial (default: 30)")
    options = parser.parse_args(arguments)
    if min(options.pairs, options.trials, options.epochs) < 1:
        raise UserError("--pairs, --trials and --epochs must be positive")
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError:
        raise UserError("the study needs optuna; install it with: pip install 'sgslam[tune]'") from None
    plans = read_raw(options.plans)

    from data.common.files import write_json
    from matching.published.data import drawn_pairs, split
    from matching.published.network import PUBLISHED

    options.out.mkdir(parents=True, exist_ok=True)
    pairs = split(drawn_pairs(options.pairs, options.seed, plans, PUBLISHED), options.seed)
    storage = JournalStorage(JournalFileBackend(str(options.out / "study.log")))
    study = optuna.create_study(study_name=STUDY, storage=storage, load_if_exists=True)
    there = study.get_trials(states=(optuna.trial.TrialState.COMPLETE, optuna.trial.TrialState.PRUNED))
    # the seed differs after an interruption, so that no point is tried twice
    study.sampler = optuna.samplers.TPESampler(seed=options.seed + len(study.trials))
    study.pruner = optuna.pruners.MedianPruner()
    study.optimize(
        lambda trial: _trial(trial, pairs, options.seed, options.epochs), n_trials=max(options.trials - len(there), 0)
    )
    best = {"validation loss": study.best_value, **study.best_trial.user_attrs, "parameters": study.best_params}
    write_json(options.out / "best.json", {**best, "trials": len(study.trials)})
    print(f"best of {len(study.trials)} trials: {best}")
    return 0


def _trial(trial: Any, pairs: "PaperSplit", seed: int, epochs: int) -> float:
    """The lowest validation loss of a trial."""
    import optuna

    from matching.published.trainer import PaperTraining, Row, train

    settings, recipe = _suggested(trial, epochs)
    training = PaperTraining.begin(settings, recipe, pairs, seed)

    def on_evaluation(row: Row) -> None:
        trial.report(row["validation loss"], int(row["epoch"]))
        best = min(training.curve, key=lambda r: r["validation loss"])
        trial.set_user_attr("validation accuracy", best["validation accuracy"])
        if trial.should_prune():
            raise optuna.TrialPruned

    train(training, pairs, on_evaluation)
    return min(row["validation loss"] for row in training.curve)


def _suggested(trial: Any, epochs: int) -> tuple["PaperSettings", "Recipe"]:
    """Samples a point of the public code's search space."""
    from matching.published.network import PaperSettings
    from matching.published.trainer import Recipe

    settings = PaperSettings(
        hidden=trial.suggest_categorical("hidden", [32, 64, 128]),
        out=trial.suggest_categorical("out", [16, 32, 64]),
        layers=trial.suggest_int("layers", 1, 3),
        heads=trial.suggest_int("heads", 1, 4),
        dropout=trial.suggest_float("dropout", 0.0, 0.6),
        attention_dropout=trial.suggest_float("attention_dropout", 0.0, 0.6),
        temperature=trial.suggest_float("temperature", 0.01, 1.0),
        sinkhorn=trial.suggest_int("sinkhorn", 10, 100),
    )
    recipe = Recipe(
        rate=trial.suggest_float("rate", 1e-4, 1e-2, log=True),
        decay=trial.suggest_float("decay", 1e-6, 1e-3, log=True),
        batch=trial.suggest_categorical("batch", [8, 16, 32]),
        epochs=epochs,
        patience=PATIENCE,
    )
    return settings, recipe


if __name__ == "__main__":
    run_command(main)
