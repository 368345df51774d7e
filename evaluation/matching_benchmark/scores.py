"""The scores of each match, as columns of the rows, and their means over a set of rows."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluation.matching_benchmark.methods import ORACLE
from evaluation.matching_benchmark.pairs import REGIMES, SGSLAM
from evaluation.matching_benchmark.plan_sets import name_of_set, size_class, split_of
from evaluation.metrics.bootstrap import Estimate, ratio
from evaluation.metrics.calibration import BINS, Bin

BASE = "voting"
UNANSWERED = ("late", "failed")  # the method took too long, or raised
LEAST_GAP = 0.02  # of F1 between oracle and base, below which no share is given
PAIR = ("plans", "plan", "source", "regime", "rooms", "index", "seed")
TALLIES = ("wall", "room")
ORDER = {regime: n for n, regime in enumerate((*REGIMES, SGSLAM))}


def scored(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, the last one of each pair and method, with the pair's fields under their own names and scores of each.

    `wall_f1`, `wall_precision`, `wall_recall` and `wall_accuracy`, and those of `room`, are missing where there is
    nothing to measure. Accuracy is the share of S nodes with a correct answer: matched with their true match, or
    unmatched if they have none. A pair is `perfect` if all rooms and walls with a true match are matched with it and
    nothing else is matched. `decided` is `unique` of the pairs without an alternative placement. `unanswered` are
    those that took too long or raised: none of their nodes is right. `filled_f1` is `wall_f1`, and 1 where there was
    nothing to find and the answer matched nothing; `base_f1` and `oracle_f1` are those of
    `voting` and the oracle on the same pair. `building` is one name over all sets. Regimes are in order.
    """
    own = rows.rename(columns=lambda name: name.removeprefix("pair."))
    own["source"] = own.source.map(str)
    own["pair"] = own.groupby(list(PAIR), dropna=False).ngroup()
    own = own.drop_duplicates(["pair", "method"], keep="last")
    own = own.sort_values("regime", key=lambda regimes: regimes.map(ORDER), kind="stable", ignore_index=True)
    own["set"] = own.plans.map(name_of_set)
    own["split"] = [split_of(*names) for names in zip(own.plans, own.plan, strict=True)]
    own["size_class"] = own["size"].map(size_class)
    own["building"] = pd.factorize(own["set"] + "/" + own.building, sort=True)[0]
    own["rooms"] = own.rooms.astype(float).fillna(np.inf)
    for kind in TALLIES:
        own = own.assign(**scores_of(own, kind))
    own["perfect"] = _share(own.wall_perfect & own.room_perfect, own["wall_tally.true"] + own["room_tally.true"] > 0)
    own["unanswered"] = own.status.isin(UNANSWERED).astype(float)
    for status in ("unique", "ambiguous", "none"):
        own[status] = (own.status == status).astype(float)
    own["decided"] = own.unique.where(own.twin.eq(False))
    nothing = (own["wall_tally.true"] + own["wall_tally.answered"] == 0) & (own.unanswered == 0)
    own["filled_f1"] = own.wall_f1.fillna(0.0).mask(nothing, 1.0)
    for name, method in (("base_f1", BASE), ("oracle_f1", ORACLE)):
        own[name] = own.pair.map(own[own.method == method].set_index("pair").filled_f1)
    unused = [name for name in own if name.startswith("made.") or name.endswith("_tally.bins")]
    return own.drop(columns=["reason", "limit_s", "source", *unused]).copy()  # in one piece, which is faster


def scores_of(rows: pd.DataFrame, kind: str) -> dict[str, "pd.Series[float] | list[NDArray[np.float64]]"]:
    """The scores of one kind of nodes for each row, as columns (see `scored`), from the columns `KIND_tally`."""
    right, answered, true, spare, left = (
        rows[f"{kind}_tally.{name}"].astype(float) for name in ("right", "answered", "true", "spare", "left")
    )
    left = left.mask(rows.status.isin(UNANSWERED), 0.0)
    scores = {
        "precision": _share(right, answered), "recall": _share(right, true),
        "f1": _share(2 * right, answered + true).where(true > 0), "accuracy": _share(right + left, true + spare),
        "perfect": (right == answered) & (answered == true), "bins": list(_bins(rows[f"{kind}_tally.bins"])),
    }  # fmt: skip
    return {f"{kind}_{name}": values for name, values in scores.items()}


def _share(part: "pd.Series[float]", whole: "pd.Series[float]") -> "pd.Series[float]":
    return part.astype(float) / whole.astype(float).where(whole > 0)


def _bins(of: "pd.Series[Sequence[Sequence[float]]]") -> NDArray[np.float64]:
    """(N, BINS, 3) the count, the right ones and the sum of the confidences in each bin of each row."""
    found = np.zeros((len(of), BINS, 3))
    row = np.repeat(np.arange(len(of)), of.map(len))
    flat = np.array(list(chain.from_iterable(of)), dtype=float).reshape(-1, 4)
    np.add.at(found, (row, flat[:, 0].astype(int)), flat[:, 1:])
    return found


def bins_of(rows: pd.DataFrame, kind: str) -> tuple[Bin, ...]:
    """The confidences of all answers for walls or rooms, in bins."""
    total = np.sum(rows[f"{kind}_bins"].tolist(), axis=0)
    return tuple(Bin(k, int(n), int(right), float(sure)) for k, (n, right, sure) in enumerate(total) if n)


def estimate(rows: pd.DataFrame, score: str) -> Estimate | None:
    """The mean of a score where it is known, with its interval by bootstrap over buildings."""
    values = rows[score].to_numpy(dtype=float)
    known = ~np.isnan(values)
    return ratio(np.where(known, values, 0.0), known, rows.building)


def micro_f1(rows: pd.DataFrame, kind: str) -> float | None:
    """F1 of all nodes together; None without any."""
    right, answered, true = (rows[f"{kind}_tally.{name}"].sum() for name in ("right", "answered", "true"))
    return 2 * right / (answered + true) if answered + true else None


def gain(rows: pd.DataFrame) -> tuple[Estimate, float | None, int] | None:
    """For rows of one method: the mean of F1 - F1(voting) over their common pairs, with its interval by bootstrap over
    buildings, the share of the gap between voting and the oracle that is closed on the common pairs of all three (None
    if it is small), and the number of pairs; None without common pairs."""
    both = rows[rows.base_f1.notna()]
    difference = ratio(both.filled_f1 - both.base_f1, np.ones(len(both)), both.building)
    if difference is None:
        return None
    three = both[both.oracle_f1.notna()]
    gap = (three.oracle_f1 - three.base_f1).sum()
    closed = (three.filled_f1 - three.base_f1).sum() / gap if gap >= LEAST_GAP * max(len(three), 1) else None
    return difference, closed, len(both)
