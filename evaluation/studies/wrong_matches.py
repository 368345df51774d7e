"""Robustness to wrong matches: runs with corrupted matches against clean runs.

In every unique answer of the matcher, some rooms with all their walls are assigned to wrong planned rooms. The final
trajectory is measured: wrong matches must be withdrawn or outvoted.
"""

from collections.abc import Mapping

import pandas as pd
from pydantic import PositiveInt

from evaluation.drives.conditions import NORMAL, Conditions
from evaluation.drives.sequences import DriveOptions
from evaluation.harness import Study
from evaluation.harness.tables import of
from evaluation.slam_ablation.scores import Scores
from evaluation.slam_ablation.study import Run, measure

WRONG = "conditions.wrong_matches"
MEASURED = ["rmse_m", "first_anchor_s", "matched_poses", "poses"]


class Choice(DriveOptions):
    """The drives, and the number of rooms that are matched wrongly."""

    sequences: tuple[str, ...] = ("institute", "office")
    rooms: PositiveInt = 5


def cases(options: Choice) -> list[Run]:
    """Each drive with clean and with corrupted matches."""
    return [
        Run(sequence=spec, seed=seed, conditions=conditions, variant="anchored")
        for spec, seed in options.drives() for conditions in (NORMAL, Conditions(wrong_matches=options.rooms))
    ]  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each drive, and for each building over its drives."""
    lines = []
    for (name, rooms), own in _paired(rows).groupby(["sequence.name", WRONG], sort=False):
        lines += [_line(name, rooms, seed, drive) for seed, drive in own.groupby("seed", sort=False)]
        if len(own) > 1:
            lines.append(_line(f"**{name}**", rooms, "all", own))
    return {"drives": pd.DataFrame(lines)}


def _paired(rows: pd.DataFrame) -> pd.DataFrame:
    """The corrupted runs, with the values of the clean run of the same drive as `NAME_clean`."""
    rows = rows.astype(dict.fromkeys(MEASURED, float))
    clean, drive = rows[rows[WRONG] == 0], ["sequence.name", "seed"]
    return rows[rows[WRONG] > 0].merge(clean[[*drive, *MEASURED]], on=drive, suffixes=("", "_clean"))


def _line(name: str, rooms: int, seed: object, own: pd.DataFrame) -> dict[str, str]:
    mean = own[["rmse_m", "rmse_m_clean", "first_anchor_s", "first_anchor_s_clean"]].mean(skipna=False)
    return {
        "drive": name, "wrong rooms": str(rooms), "seed": str(seed),
        "clean (m)": _cell(mean.rmse_m_clean, ".4f", "not anchored"),
        "corrupted (m)": _cell(mean.rmse_m, ".4f", "not anchored"),
        "coverage, clean": of(own.matched_poses_clean.sum(), own.poses_clean.sum()),
        "coverage, corrupted": of(own.matched_poses.sum(), own.poses.sum()),
        "ratio": _cell(mean.rmse_m / mean.rmse_m_clean, ".2f"),
        "first anchor, clean (s)": _cell(mean.first_anchor_s_clean, ".0f"),
        "first anchor, corrupted (s)": _cell(mean.first_anchor_s, ".0f"),
    }  # fmt: skip


def _cell(value: float, form: str, missing: str = "") -> str:
    return missing if pd.isna(value) else format(value, form)


STUDY = Study(
    "wrong_matches", "what becomes of a run in which rooms are matched wrongly",
    Choice, Choice(sequences=("institute",), seeds=(0,)), Run, Scores, cases, measure, tables,
)  # fmt: skip
