"""The tables of runs with troubles."""

from collections.abc import Mapping

import pandas as pd

from evaluation.drives.troubles import TROUBLES
from evaluation.harness import Claim
from evaluation.harness.tables import coverage, grouped, of, rare, spread
from evaluation.metrics.regions import PARTS, pooled
from evaluation.studies.carried.carriers_tables import named

_REGIONS = tuple(f"inside.{name}" for name in ("poses", *PARTS))


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each trouble; for each trouble and carrier; and for each set of effects. How many of the runs
    that anchor with scans levelled by the truth do so without, and how many errors are where they are said to be."""
    runs = _by_trouble(rows)
    plain = runs[runs.trouble == "none"]
    return {
        "troubles": grouped(runs, ["trouble"], _cells),
        "carriers": grouped(runs, ["trouble", "carrier"], _cells),
        "effects": grouped(plain, ["effects"], _cells),
        "levelled": grouped(_with_levelled(runs), ["carrier"], _still),
        "inside": grouped(runs[runs["inside.poses"].notna()], ["trouble"], pooled),
    }


def _by_trouble(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each drive and trouble: the drive in words, and the run."""
    rows, lines = named(rows), []
    for trouble in TROUBLES:
        own = {name: name.removeprefix(f"found.{trouble}.") for name in rows if name.startswith(f"found.{trouble}.")}
        if own:
            others = [name for name in rows if name.startswith("found.") and name not in own]
            lines.append(rows.drop(columns=others).rename(columns=own).assign(trouble=trouble).dropna(subset="scans"))
    runs = pd.concat(lines, ignore_index=True).reindex(columns=_with_missing(lines))
    return runs.assign(coverage=(runs.anchored / runs.scans).where(runs.rmse_m.notna()))


def _with_missing(lines: list[pd.DataFrame]) -> list[str]:
    """The columns of all lines; those of regions too where none is known."""
    there = list(dict.fromkeys(name for line in lines for name in line))
    return there + [name for name in _REGIONS if name not in there]


def _with_levelled(runs: pd.DataFrame) -> pd.DataFrame:
    """The runs without trouble whose levelled run is anchored."""
    levelled = runs[(runs.trouble == "levelled") & (runs.anchored > 0)]
    return runs[(runs.trouble == "none") & runs.drive.isin(levelled.drive)]


def _still(own: pd.DataFrame) -> dict[str, str]:
    return {"anchored with the true attitude": str(len(own)), "and without": of((own.anchored > 0).sum(), len(own))}


def _cells(own: pd.DataFrame) -> dict[str, str]:
    return {
        "drives": str(len(own)), "anchored": of((own.anchored > 0).sum(), len(own)),
        "scans anchored": f"{own.anchored.sum() / own.scans.sum():.1%}",
        "scans lost": f"{own.lost.sum() / own.scans.sum():.1%}",
        "RMSE (m)": spread(own.rmse_m, ".3f"), "coverage": coverage(own),
        "drives wrong": of((own.wrong > 0).sum(), len(own)), "scans wrong": of(own.wrong.sum(), own.scans.sum()),
        "wrong while it ran": of((own.wrong_live > 0).sum(), len(own)),
        "wrong and no alarm": of(((own.wrong > 0) & (own.alarms.map(len) == 0)).sum(), len(own)),
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a run was anchored wrongly."""
    runs = _by_trouble(rows)
    anchored, wrong = runs[runs.anchored > 0], runs[runs.wrong > 0]
    cases = f"{len(runs)} runs, {runs.trouble.nunique()} kinds of trouble"
    text = "Whatever goes wrong: of the anchored runs, with an anchored scan that is wrong by over 0.5 m or 5 degrees"
    return [
        Claim(text, rare(len(wrong), len(anchored)), cases),
        Claim("Of these, without an alarm", of((wrong.alarms.map(len) == 0).sum(), len(wrong)), cases),
    ]
