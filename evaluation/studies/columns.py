"""Names and columns that several studies of runs share."""

from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from evaluation.cases import DriveCase
from evaluation.drive import release
from evaluation.metrics.consistency import PARTS
from evaluation.run import run
from evaluation.study import Options, Study
from evaluation.tables import Column, count, mean, of, share, spread

ANCHORED = {
    "runs": count(),
    "anchored": count(lambda rows: truth(rows, "anchored")),
    "coverage": share("anchored_scans", "scans"),
    "RMSE (m)": spread("rmse_m", ".3f"),
}
"""How many runs are anchored, the share of all scans that are, and the error of these in building coordinates."""
ERRORS = {
    "plan view (m)": spread("plan_view_m", ".3f"),
    "height (m)": spread("height_m", ".3f"),
    "yaw (deg)": spread("yaw_deg", ".2f"),
    "worst (m)": spread("worst_m", ".2f"),
}
WRONG = {
    "wrong": count(lambda rows: rows.wrong > 0),
    "wrong while it ran": count(lambda rows: rows.wrong_live > 0),
    "wrong and no alarm": count(lambda rows: truth(rows, "silent")),
}
"""Runs with an anchored scan that is off by more than 0.5 m or 5 degrees."""


def truth(rows: pd.DataFrame, name: str) -> "pd.Series[bool]":
    """A column of truth values, false where it is unknown."""
    return rows[name].eq(other=True)


def inside(part: str) -> Column:
    """A column: the share of all anchored poses whose error lies inside its 95 % region."""

    def cell(rows: pd.DataFrame) -> str:
        known = rows.reindex(columns=["inside.poses", f"inside.{part}"]).dropna().astype(float)
        poses = known["inside.poses"].sum()
        return f"{100 * (known['inside.poses'] * known[f'inside.{part}']).sum() / poses:.1f} %" if poses else ""

    return cell


INSIDE = {f"{part.replace('_', ' ')} in its 95 % region": inside(part) for part in PARTS}


def in_words(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with carrier, effects and mount as texts, and `worse`: the trouble without its severity."""
    carriers = zip(rows.carrier, rows.pace, rows.backwards, strict=True)
    return rows.assign(
        carrier=[_carrier(*carrier) for carrier in carriers],
        effects=[" + ".join(effects) or "none" for effects in rows.effects],
        mount=[", ".join(f"{angle:g}" for angle in mount) for mount in rows.mount_deg],
        points=rows.times.map({True: "with times", False: "without times"}),
    )


def _carrier(name: str, pace: float, backwards: bool) -> str:
    if not name.endswith(".tum"):
        return name
    return "recorded hand" + (", backwards" if backwards else "") + (f", pace {pace:g}" if pace != 1 else "")


def study_of_runs(
    name: str,
    asks: str,
    quick: Options,
    cases: Callable[[Any], Sequence[DriveCase]],
    tables: Callable[[pd.DataFrame], Any],
    claims: Callable[[pd.DataFrame], Any],
    **more: Any,
) -> Study:
    """A study whose cases are runs on drives."""
    return Study(
        name=name,
        asks=asks,
        options=type(quick),
        quick=quick,
        case=DriveCase,
        cases=cases,
        tables=lambda rows: tables(in_words(rows)),
        claims=lambda rows: claims(in_words(rows)),
        **{"measure": run, "release": release, **more},
    )


__all__ = ["ANCHORED", "ERRORS", "INSIDE", "WRONG", "in_words", "inside", "mean", "of", "study_of_runs", "truth"]
