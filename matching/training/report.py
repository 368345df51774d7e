"""The files of a training run: learning curve, model card."""

import csv
import io
import subprocess
from pathlib import Path
from typing import Any

from data.common.files import write_atomically, write_json

Row = dict[str, float]


def write_curve(folder: Path, curve: list[Row]) -> None:
    """Writes `curve.csv`: a row for each evaluation on the held-out buildings."""
    names = list(dict.fromkeys(name for row in curve for name in row))
    text = io.StringIO()
    table = csv.DictWriter(text, names, lineterminator="\n")
    table.writeheader()
    table.writerows({k: f"{v:.6g}" for k, v in row.items()} for row in curve)
    write_atomically(folder / "curve.csv", text.getvalue())


def write_card(folder: Path, card: dict[str, Any]) -> None:
    """Writes `model_card.json`: data, seed, command, commit and accuracies."""
    write_json(folder / "model_card.json", {**card, "commit": _commit()})


def _commit() -> str | None:
    """The commit of this program, with `-dirty` if modified; None outside a repository."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        here = Path(__file__).parent
        done = subprocess.run(command, cwd=here, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
