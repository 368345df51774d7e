"""Rows as a DataFrame, queries on them, and the text of a table's cells.

Units of a bound or an interval are buildings, not rows: what happens in one building is not independent. With fewer
than five of them none is given.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from evaluation.metrics.statistics import Estimate, ratio, upper_bound
from evaluation.metrics.trajectories import PARTS
from evaluation.rows import Row

LEAST_UNITS = 5
Column = Callable[[pd.DataFrame], str]
"""The text of a cell, made of the rows of a line."""


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """A line for each row that did not fail: the fields of case and record, those of their parts as `part.field`, and
    the provenance as `made.build` and so on."""
    kept = [{**row.case, **row.record, "made": row.made.model_dump()} for row in rows if not row.failed]
    return pd.json_normalize(kept)


@dataclass(frozen=True)
class Query:
    """A table: the rows that `where` keeps (None: all), a line for each group with the same values of `by` (column to
    title; one with the same value in all lines is left out, but for the last), and the columns by their titles."""

    by: Mapping[str, str]
    columns: Mapping[str, Column]
    where: Callable[[pd.DataFrame], "pd.Series[bool]"] | None = None

    def table(self, rows: pd.DataFrame) -> pd.DataFrame:
        """The table of these rows; groups are in the rows' order."""
        kept = rows if self.where is None else rows[self.where(rows)]
        lines = []
        for key, own in kept.groupby(list(self.by), sort=False, dropna=False):
            names = dict(zip(self.by.values(), (_text(value) for value in key), strict=True))
            lines.append({**names, **{title: column(own) for title, column in self.columns.items()}})
        made = pd.DataFrame(lines)
        same = [title for title in list(self.by.values())[:-1] if len(made) > 1 and made[title].nunique() == 1]
        return made.drop(columns=same)


def made(queries: Mapping[str, Query], rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The tables of queries, by name; those without a line are left out."""
    tables = {name: query.table(rows) for name, query in queries.items()}
    return {name: table for name, table in tables.items() if len(table)}


def spread(name: str, form: str = ".0f", factor: float = 1.0) -> Column:
    """A column: the median, and the least and largest of the known values; a single value alone."""
    return lambda own: spread_of(factor * _column(own, name), form)


def spread_of(values: "pd.Series[Any]", form: str = ".0f") -> str:
    """The median, and the least and largest of the known values; a single value alone, empty without any. An infinite
    one is that of a lost tracker."""
    known = values.dropna().astype(float)
    ends = (known.median(), known.min(), known.max()) if len(known) else ()
    texts = ["lost" if np.isinf(value) else f"{value:{form}}" for value in ends]
    return f"{texts[0]} ({texts[1]}–{texts[2]})" if len(known) > 1 else "".join(texts[:1])


def mean(name: str, form: str = ".3f", factor: float = 1.0) -> Column:
    """A column: the mean of the known values, with its interval by bootstrap over buildings where there are enough."""
    return lambda own: interval(over_buildings(_column(own, name), own.building), form, factor)


def over_buildings(values: "pd.Series[Any]", building: "pd.Series[Any]") -> Estimate | None:
    """The mean of the known values, with the 95 % interval over buildings where there are five; None without any."""
    known = values.notna()
    return ratio(values[known].astype(float), known[known], building[known].astype(str).tolist(), LEAST_UNITS)


def interval(estimate: Estimate | None, form: str = ".3f", factor: float = 1.0) -> str:
    """A value, with its interval if it has one; empty for None."""
    if estimate is None:
        return ""
    texts = [format(factor * value, form) for value in (estimate.value, estimate.low, estimate.high)]
    return texts[0] if np.isnan(estimate.low) else f"{texts[0]} [{texts[1]}, {texts[2]}]"


def count(where: Callable[[pd.DataFrame], "pd.Series[bool]"] | None = None) -> Column:
    """A column: how many rows there are, or of them those where something holds, as `part/whole`."""
    return lambda own: str(len(own)) if where is None else of(where(own).sum(), len(own))


def total(part: str, whole: str) -> Column:
    """A column: the sum of one field over that of another, as `part/whole`."""
    return lambda own: of(_column(own, part).sum(), _column(own, whole).sum())


def share(part: str, whole: str) -> Column:
    """A column: the sum of one field over that of another, in percent."""
    return lambda own: f"{100 * _column(own, part).sum() / max(_column(own, whole).sum(), 1):.1f}"


def of(part: float, whole: float) -> str:
    """A share as `part/whole`; empty without a whole."""
    return f"{part:.0f}/{whole:.0f}" if whole else ""


def rare(event: "pd.Series[bool]", building: "pd.Series[Any]", what: str = "runs") -> str:
    """How often something rare was seen: in how many rows and buildings, with the exact 97.5 % upper bound of the share
    of buildings in which it is seen, where there are five."""
    return _bounded(event, building, what, "≤", upper_bound)


def often(event: "pd.Series[bool]", building: "pd.Series[Any]", what: str = "runs") -> str:
    """How often something frequent was seen: in how many rows, and in how many buildings always, with the exact 97.5 %
    lower bound of the share of such buildings, where there are five."""
    return _bounded(event, building, what, "≥", lambda n, whole: 1 - upper_bound(whole - n, whole), always=True)


def _bounded(
    event: "pd.Series[bool]",
    building: "pd.Series[Any]",
    what: str,
    sign: str,
    bound: Callable[[int, int], float],
    always: bool = False,
) -> str:
    if not len(event):
        return ""
    by = event.astype(bool).groupby(building.astype(str))
    units = by.all() if always else by.any()
    hit, whole = int(units.sum()), len(units)
    limit = f" ({sign} {100 * bound(hit, whole):.0f} %)" if whole >= LEAST_UNITS else ""
    return f"{int(event.sum())}/{len(event)} {what}".rstrip() + f", {hit}/{whole} buildings{limit}"


def units(rows: pd.DataFrame) -> str:
    """How many drives and buildings the rows are of."""
    drives = rows.drive.nunique() if "drive" in rows else len(rows)
    return f"{drives} drives, {rows.building.nunique()} buildings"


def markdown(table: pd.DataFrame) -> str:
    """The table in Markdown; missing values are empty."""
    lines: list[Sequence[Hashable]] = [list(table.columns), ["---"] * len(table.columns)]
    lines += table.astype(object).where(table.notna(), "").to_numpy().tolist()
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def _column(own: pd.DataFrame, name: str) -> "pd.Series[Any]":
    """A column as numbers; empty if the rows do not have it."""
    return pd.to_numeric(own.reindex(columns=[name])[name])


def _text(value: Any) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:g}"
    return str(value)


ANCHORED = {
    "anchored": count(lambda rows: truth(rows, "anchored")),
    "coverage (%)": share("anchored_scans", "scans"),
    "RMSE (m)": spread("rmse_m", ".3f"),
}
"""How many runs of all are anchored, the share of scans that are, and the error of these in building coordinates."""
ERRORS = {
    "plan view (m)": spread("plan_view_m", ".3f"),
    "height (m)": spread("height_m", ".3f"),
    "yaw (deg)": spread("yaw_deg", ".2f"),
}
WRONG = {
    "wrong": count(lambda rows: rows.wrong > 0),
    "wrong while it ran": count(lambda rows: rows.wrong_live > 0),
    "wrong and no alarm": count(lambda rows: truth(rows, "silent")),
}
"""Runs with an anchored scan that is off by more than 0.5 m or 5 degrees."""
EVER_WRONG: dict[str, Column] = {"ever wrong": count(lambda rows: (rows.wrong > 0) | (rows.wrong_live > 0))}
"""The same, in the end or while it ran."""


def truth(rows: pd.DataFrame, name: str) -> "pd.Series[bool]":
    """A column of truth values, false where it is unknown."""
    return rows[name].eq(other=True)


def inside(part: str) -> Column:
    """A column: the share of all anchored poses whose error lies inside its 95 % region, in percent."""

    def cell(rows: pd.DataFrame) -> str:
        known = rows.reindex(columns=["inside.poses", f"inside.{part}"]).dropna().astype(float)
        poses = known["inside.poses"].sum()
        return f"{100 * (known['inside.poses'] * known[f'inside.{part}']).sum() / poses:.1f}" if poses else ""

    return cell


INSIDE = {f"{part.replace('_', ' ')} in its 95 % region (%)": inside(part) for part in PARTS}


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
