"""The tables and the claims of the matching benchmark, made from its rows."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pandas as pd
from scipy.special import ndtr

from evaluation.harness import Claim
from evaluation.harness.tables import grouped, interval, rare
from evaluation.matching_benchmark.methods import ORACLE
from evaluation.matching_benchmark.pairs import NEGATIVE
from evaluation.matching_benchmark.scores import (
    BASE,
    TALLIES,
    bins_of,
    estimate,
    gain,
    micro_f1,
    scored,
)
from evaluation.metrics.calibration import calibration_error
from matching.ambiguity.symmetries import EQUAL, SURE

LINES = ("regime", "method")
SUMMARY_METHODS, SUMMARY_REGIMES = ("learned", BASE), ("real", "drift", "mis_segmented", "heavy_drift", NEGATIVE)


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame | str]:
    """For validation and test plans of each size: wall and room F1 and unique answers by rooms seen, all measures, and
    gains against voting, with and without the pairs that have an alternative placement. For each set of plans: wall F1
    and all measures. Symmetric plans, and a summary of the test plans."""
    own = scored(rows)
    found: dict[str, pd.DataFrame | str] = {}
    for (split, size), group in own.groupby(["split", "size_class"]):
        found |= _named(f"{split}_{size}", _about(group), _tables_of(group))
    for name, group in own.groupby("set"):
        found |= _named(str(name), _about(group), {"wall_f1": _wall_f1(group), "measures": _all(group)})
    twins = own[own.rival.notna() & (own.method != ORACLE)]
    alike = pd.Series(np.where(twins.rival < EQUAL, "equal", "alike"), twins.index)
    found["symmetric"] = grouped(twins.assign(alternatives=alike), ("method", "alternatives"), _symmetric)
    summary = own[own.regime.isin(SUMMARY_REGIMES) & own.method.isin(SUMMARY_METHODS) & (own.split == "test")]
    found["summary"] = grouped(summary, LINES, _summary)
    return {name: table for name, table in found.items() if len(table)}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """Wall F1 of the learned matcher, and its wrong answers, on test plans."""
    own = scored(rows)
    own = own[(own.method == "learned") & (own.split == "test")]
    found = []
    for regime, what in (("real", "maps with the noise of real scans"), ("drift", "maps that drift")):
        part = own[own.regime == regime]
        text = f"Wall F1 of the learned matcher on {what}, on plans by which no setting was chosen"
        found.append(Claim(text, interval(estimate(part, "wall_f1")), f"{len(part)} maps"))
    text = "Unique answers of the learned matcher that are wrong, all noise models and the published perturbation"
    found.append(Claim(text, _wrong(own), f"{len(own)} maps"))
    negative = own[own.regime == NEGATIVE]
    text = "Maps of another building that the learned matcher places uniquely"
    return [*found, Claim(text, rare(int(negative.unique.sum()), len(negative)), f"{len(negative)} maps")]


def _named(group: str, about: str, of: dict[str, pd.DataFrame]) -> dict[str, pd.DataFrame | str]:
    """The tables of a group, and what its plans are, with the group's name."""
    return {f"about_{group}": about, **{f"{table}_{group}": value for table, value in of.items()}}


def _about(rows: pd.DataFrame) -> str:
    """The plans of a group in a few words."""
    plans = rows.drop_duplicates(["plans", "plan"])
    sets = ", ".join(f"`{name}`" for name in sorted(plans["set"].unique()))
    return f"{len(plans)} plans of {sets}, {plans['size'].min()} to {plans['size'].max()} rooms"


def _tables_of(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    to_find = rows[rows.regime != NEGATIVE]
    compared = to_find[~to_find.method.isin((BASE, ORACLE)) & to_find.base_f1.notna()]
    return {
        "wall_f1": _wall_f1(rows),
        "room_f1": _by_rooms(to_find, partial(_mean, score="room_f1")),
        "unique": _by_rooms(rows[rows.method != ORACLE], _unique),
        "measures": _all(rows),
        "gains": _by_rooms(compared, _gain),
        "gains_without_alternative": _by_rooms(compared[compared.twin.eq(False)], _gain),
    }


def _wall_f1(rows: pd.DataFrame) -> pd.DataFrame:
    return _by_rooms(rows[rows.regime != NEGATIVE], partial(_mean, score="wall_f1"))


def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return grouped(rows, LINES, _measures)


def _by_rooms(rows: pd.DataFrame, cell: Callable[[pd.DataFrame], str]) -> pd.DataFrame:
    """A line for each regime and method, a column for each number of rooms seen."""
    columns = sorted(rows.rooms.unique())

    def cells(own: pd.DataFrame) -> dict[str, str]:
        parts = dict(iter(own.groupby("rooms")))
        counts = sorted({len(part) for part in parts.values()})
        pairs = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
        by_rooms = {n: cell(parts[n]) if n in parts else "" for n in columns}
        return {**{"all" if n == np.inf else f"{n:.0f}": text for n, text in by_rooms.items()}, "pairs a cell": pairs}

    return grouped(rows, LINES, cells)


def _mean(rows: pd.DataFrame, score: str) -> str:
    return interval(estimate(rows, score))


def _unique(rows: pd.DataFrame) -> str:
    return f"{100 * rows.unique.mean():.0f} % · {rows.wrong.sum()}/{rows.unique.sum():.0f}"


def _gain(rows: pd.DataFrame) -> str:
    found = gain(rows)
    if found is None:
        return ""
    difference, closed, pairs = found
    share = "" if closed is None else f" · {100 * closed:.0f} %"
    return f"{interval(difference, '+.3f')}{share} ({pairs})"


def _measures(rows: pd.DataFrame) -> dict[str, str]:
    names = {"precision": "P", "recall": "R", "f1": "F1", "accuracy": "acc"}
    nodes = {f"{kind} {name}": _mean(rows, f"{kind}_{of}") for kind in TALLIES for of, name in names.items()}
    micro = {f"{kind} micro F1": _number(micro_f1(rows, kind)) for kind in TALLIES}
    shares = ("perfect", "unique", "ambiguous", "none", "unanswered", "decided")
    return {
        "pairs": str(len(rows)), **nodes, **micro,
        **{f"{name} (%)": interval(estimate(rows, name), ".0f", 100.0) for name in shares},
        "wrong of unique": _wrong(rows),
        **{f"{kind} ECE": _number(calibration_error(bins_of(rows, kind))) for kind in TALLIES},
        "median (s)": f"{rows.seconds.median():.3f}", "95 % (s)": f"{rows.seconds.quantile(0.95):.3f}",
        "late": str((rows.status == "late").sum()), "failed": str((rows.status == "failed").sum()),
    }  # fmt: skip


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _summary(rows: pd.DataFrame) -> dict[str, str]:
    return {
        "pairs": str(len(rows)), "wall F1": _mean(rows, "wall_f1"), "unique": f"{100 * rows.unique.mean():.0f} %",
        "wrong of unique": _wrong(rows), "median (s)": f"{rows.seconds.median():.3f}",
    }  # fmt: skip


def _wrong(rows: pd.DataFrame) -> str:
    return rare(int(rows.wrong.sum()), int(rows.unique.sum()))


def _symmetric(rows: pd.DataFrame) -> dict[str, str]:
    return {
        "pairs": str(len(rows)), "unique": f"{rows.unique.sum():.0f}", "wrong": str(rows.wrong.sum()),
        "ideal observer": f"{to_be_sure(rows.rival):.1f}",
        "ambiguous": f"{rows.ambiguous.sum():.0f}", "none": f"{rows.none.sum():.0f}",
        "unanswered": f"{rows.unanswered.sum():.0f}",
    }  # fmt: skip


def to_be_sure(rivals: "pd.Series[float] | Sequence[float]") -> float:
    """The expected number of pairs whose evidence reaches `SURE`, given the expected evidence (nats) for the truth over
    the nearest alternative placement: between two Gaussian hypotheses with an expected evidence of a nats it is normal
    with mean a and variance 2 a. Negative expected evidence counts as zero."""
    nats = np.maximum(np.asarray(rivals, dtype=float), 1e-9)
    return float(ndtr((nats - SURE) / np.sqrt(2 * nats)).sum())
