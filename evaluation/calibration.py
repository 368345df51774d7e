"""`python -m evaluation.calibration ROWS`: fits the soundness of placed maps to the rows of runs of known truth.

The rows are those of the study `trust` on buildings of the training split. A map is sound if at most `WRONG_SHARE` of
the scans that it places are wrong; maps that have no place in the plan tell nothing.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_json
from evaluation.conditions import NO_PLACE
from evaluation.rows import Row, read_rows
from sgslam.anchoring.soundness import CROSSED, FILE, LAPLACE, LEAST, Model, SoundnessModel

WRONG_SHARE = 0.01  # of the placed scans
LEAST_SPREAD = 0.3  # of a logarithm: a factor of 1.35
UNSEEN = 1.0  # crossings that are added to those seen, in as many maps: that none was seen does not say never
SLIDING = 0.04  # share of sound runs through a door that is a wall in the plan; the study has more of them
Signals = Mapping[str, float]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(prog="python -m evaluation.calibration", description="Fit the soundness of placed maps.")
    parser.add_argument("rows", type=Path, nargs="+", help="rows of the study trust, of the training split")
    parser.add_argument("--out", type=Path, default=FILE, metavar="FILE", help="default: the shipped file")
    options = parser.parse_args(arguments)
    rows = [row for path in options.rows for row in read_rows(path)]
    sound, unsound = placed_maps(rows)
    if not sound or not unsound:
        raise UserError(f"{options.rows[0]}: needs sound and unsound maps; has {len(sound)} and {len(unsound)}")
    about = {
        "commands": sorted({row.made.command for row in rows}),
        "maps": {"sound": len(sound), "unsound": len(unsound)},
    }
    others = json.loads(options.out.read_text(encoding="utf-8")) if options.out.exists() else {}
    write_json(options.out, {**others, **about, **asdict(fit(sound, unsound))})
    print(f"wrote {options.out}")
    return 0


def placed_maps(rows: Sequence[Row]) -> tuple[list[Signals], list[Signals]]:
    """The signals of sound and of unsound maps."""
    maps: tuple[list[Signals], list[Signals]] = [], []
    for row in rows:
        placed, of = row.record.get("placed"), row.case
        if placed is not None and of.get("trouble") not in NO_PLACE:
            maps[int(placed["wrong"] > WRONG_SHARE * placed["scans"])].append(placed["signals"])
    return maps


def fit(sound: Sequence[Signals], unsound: Sequence[Signals]) -> SoundnessModel:
    """The noise models by maximum likelihood, then the share of the sum and the prior by a logistic regression."""
    one, other = ({name: _model(name, maps) for name in (*LAPLACE, CROSSED)} for maps in (sound, unsound))
    one[CROSSED] = SLIDING, SLIDING
    begun = SoundnessModel(one, other, prior=0.0, share=1.0)
    nats = np.array([sum(begun.judged(own).nats.values()) for own in (*sound, *unsound)])
    is_sound = np.arange(len(nats)) < len(sound)

    def loss(weights: NDArray[np.float64]) -> float:
        log_odds = weights[0] + weights[1] * nats
        return float(np.mean(np.logaddexp(0.0, np.where(is_sound, -log_odds, log_odds))))

    prior, share = minimize(loss, np.array([1.0, 0.5]), bounds=[(None, None), (0.0, 1.0)]).x.tolist()
    return SoundnessModel(one, other, round(prior, 3), round(share, 3))


def _model(name: str, maps: Sequence[Signals]) -> Model:
    values = np.array([own[name] for own in maps if own.get(name) is not None])
    if name == CROSSED:
        ratio = float((values.sum() + UNSEEN) / (values.sum() + UNSEEN + len(values)))
        return round(ratio, 4), round(ratio, 4)
    logarithms = np.log(np.maximum(values, LEAST))
    middle = float(np.median(logarithms))
    return round(middle, 3), round(max(float(np.abs(logarithms - middle).mean()), LEAST_SPREAD), 3)


if __name__ == "__main__":
    run_command(main)
