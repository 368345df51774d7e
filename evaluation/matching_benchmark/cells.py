"""The measures of a cell of the matching benchmark, computed from its rows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from evaluation.matching_benchmark.rows import Row, Tally
from evaluation.metrics.bootstrap import Estimate, ratio, upper_bound
from evaluation.metrics.calibration import Bin, calibration_error, merged
from evaluation.metrics.statistics import Score

LARGE = 34  # rooms from which a plan is large
SIZES = ("small", "large")


def size_of(rooms: int) -> str:
    """The size class of a plan: "small" below 34 rooms, else "large"."""
    return SIZES[rooms >= LARGE]


@dataclass(frozen=True)
class NodeMeasures:
    """The measures of rooms or of wall surfaces: means over pairs; `micro_f1` is that of all nodes together.

    Accuracy is the share of S nodes with a correct answer: matched with their true match, or unmatched if they have
    none.
    """

    precision: Estimate | None
    recall: Estimate | None
    f1: Estimate | None
    accuracy: Estimate | None
    micro_f1: Estimate | None
    calibration_error: float | None
    bins: tuple[Bin, ...]


@dataclass(frozen=True)
class Measures:
    """The measures of a set of rows.

    `unique`, `ambiguous` and `none` are shares of all pairs. A pair is `perfect` if all rooms and walls with a true
    match are matched with it and nothing else is matched. `decided` is the share of unique answers among pairs without
    an alternative placement. `wrong` of the `uniques` unique answers are wrong, a share of at most `wrong_bound`
    (one-sided 97.5 %). `slow_s` is the 95th percentile of the time, `completed` the share answered within the limit.
    """

    pairs: int
    rooms: NodeMeasures
    walls: NodeMeasures
    perfect: Estimate | None
    unique: Estimate | None
    ambiguous: Estimate | None
    none: Estimate | None
    decided: Estimate | None
    wrong: int
    uniques: int
    wrong_bound: float
    median_s: float
    slow_s: float
    completed: float
    failed: int


def measure(rows: Sequence[Row]) -> Measures:
    """All measures of at least one row."""
    building = [f"{r.plans}/{r.building}" for r in rows]

    def share(of: Callable[[Row], bool], among: Callable[[Row], bool] = lambda r: True) -> Estimate | None:
        base = [among(r) for r in rows]
        return ratio([b and of(r) for b, r in zip(base, rows, strict=True)], base, building)

    uniques = sum(r.status == "unique" for r in rows)
    wrong = sum(r.wrong for r in rows)
    seconds = np.array([r.seconds for r in rows])
    to_find = share(_perfect, lambda r: r.room_tally.true + r.wall_tally.true > 0)
    return Measures(
        len(rows), _nodes([r.room_tally for r in rows], building), _nodes([r.wall_tally for r in rows], building),
        to_find, share(lambda r: r.status == "unique"), share(lambda r: r.status == "ambiguous"),
        share(lambda r: r.status == "none"),
        decided=share(lambda r: r.status == "unique", lambda r: r.twin is False), wrong=wrong, uniques=uniques,
        wrong_bound=upper_bound(wrong, uniques), median_s=float(np.median(seconds)),
        slow_s=float(np.percentile(seconds, 95)), completed=sum(r.completed for r in rows) / len(rows),
        failed=sum(r.status == "failed" for r in rows),
    )  # fmt: skip


def _perfect(row: Row) -> bool:
    return all(t.right == t.answered == t.true for t in (row.room_tally, row.wall_tally))


def _nodes(tallies: list[Tally], building: list[str]) -> NodeMeasures:
    scores = [Score(t.right, t.answered, t.right, t.true) for t in tallies]
    right, answered, true, spare, left = np.array(
        [(t.right, t.answered, t.true, t.spare, t.left) for t in tallies], dtype=float
    ).T
    nodes, fair = true + spare, right + left
    bins = merged(t.bins for t in tallies)
    accuracy = [f / n if n else None for f, n in zip(fair, nodes, strict=True)]
    return NodeMeasures(
        _mean([s.precision for s in scores], building), _mean([s.recall for s in scores], building),
        _mean([s.f1 for s in scores], building), _mean(accuracy, building),
        ratio(2 * right, answered + true, building),
        calibration_error(bins), bins,
    )  # fmt: skip


def _mean(values: Sequence[float | None], building: list[str]) -> Estimate | None:
    return ratio([v or 0.0 for v in values], [v is not None for v in values], building)
