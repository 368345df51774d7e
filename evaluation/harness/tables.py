"""Rows as a DataFrame, and the text of a table's cells."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from evaluation.harness.row_file import Row
from evaluation.metrics.bootstrap import Estimate, ratio, upper_bound


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """A line for each row: the fields of case and record, those of their parts as `part.field`, and the provenance as
    `made.build` and so on."""
    return pd.json_normalize([{**row.case, **row.record, "made": row.made.model_dump()} for row in rows])


def grouped(rows: pd.DataFrame, by: Sequence[str], cells: Callable[[pd.DataFrame], dict[str, Any]]) -> pd.DataFrame:
    """A line for each group of rows with the same values of the columns `by`, in the rows' order: these values, and the
    cells of the group."""
    lines = []
    for key, own in rows.groupby(list(by), sort=False, dropna=False):
        lines.append({**dict(zip(by, key, strict=True)), **cells(own)})
    return pd.DataFrame(lines)


def mean(values: "pd.Series[Any]", form: str = ".3g", factor: float = 1.0) -> str:
    """The mean and the standard deviation of the known values; empty without any."""
    known = factor * values.dropna().astype(float)
    if not len(known):
        return ""
    return format(known.mean(), form) + (f" ± {known.std():.2g}" if len(known) > 1 else "")


def spread(values: "pd.Series[Any]", form: str = ".0f") -> str:
    """The median, and the least and largest of the known values; empty without any. An infinite one is that of a lost
    tracker."""
    known = values.dropna().astype(float)
    if not len(known):
        return ""
    median, least, most = ("lost" if np.isinf(x) else f"{x:{form}}" for x in (known.median(), known.min(), known.max()))
    return f"{median} ({least} to {most})"


def each(values: "pd.Series[Any]", form: str = ".3f") -> str:
    """The known values, with commas."""
    return ", ".join(format(float(value), form) for value in values.dropna())


def of(part: float, whole: float) -> str:
    """A share as `part/whole`; empty without a whole."""
    return f"{part:.0f}/{whole:.0f}" if whole else ""


def coverage(rows: pd.DataFrame, name: str = "coverage") -> str:
    """The mean share of a drive's scans that the errors beside it are over; `-` where the rows do not hold it."""
    known = rows.reindex(columns=[name])[name].dropna()
    return f"{100 * known.mean():.1f} %" if len(known) else "-"


def rare(count: int, whole: int) -> str:
    """How often something rare was seen, with the exact 97.5 % upper bound of its share."""
    return f"{count} of {whole}" + (f" (≤ {100 * upper_bound(count, whole):.1f} %)" if whole else "")


def often(count: int, whole: int) -> str:
    """How often something frequent was seen, with the exact 97.5 % lower bound of its share."""
    return f"{count} of {whole}" + (f" (≥ {100 * (1 - upper_bound(whole - count, whole)):.0f} %)" if whole else "")


def interval(estimate: Estimate | None, form: str = ".3f", factor: float = 1.0) -> str:
    """A value with its interval; empty for None."""
    if estimate is None:
        return ""
    value, low, high = (format(factor * x, form) for x in (estimate.value, estimate.low, estimate.high))
    return f"{value} [{low}, {high}]"


def bootstrapped(values: "pd.Series[Any]", building: "pd.Series[Any]") -> Estimate | None:
    """The mean of the known values with its interval by bootstrap over buildings."""
    known = values.notna()
    return ratio(values[known].astype(float), known[known], building[known].astype(str).tolist())


def markdown(table: pd.DataFrame) -> str:
    """The table in Markdown; missing values are empty."""
    lines: list[Sequence[Hashable]] = [list(table.columns), ["---"] * len(table.columns)]
    lines += table.astype(object).where(table.notna(), "").to_numpy().tolist()
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
