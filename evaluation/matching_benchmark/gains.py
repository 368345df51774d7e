"""Methods against each other on the same pairs: the difference of their wall F1, and how much of the gap it closes."""

from collections.abc import Sequence
from typing import Any

from evaluation.matching_benchmark.rows import ORACLE, Row
from evaluation.metrics.bootstrap import Estimate, ratio

BASE = "voting"
LEAST_GAP = 0.02  # of F1 between the oracle and the base, below which no share of it is told


def f1(row: Row) -> float:
    """Of the pair's walls; 1 where there was nothing to be found and nothing was answered."""
    t = row.wall_tally
    return 2 * t.right / (t.answered + t.true) if t.answered + t.true else 1.0


def difference(rows: Sequence[Row], method: str, base: str) -> tuple[Estimate, int] | None:
    """The mean of F1(method) - F1(base) over the pairs that both were asked, by buildings, and their number."""
    both = _both(rows, (method, base))
    if not both:
        return None
    gain = ratio([f1(m) - f1(b) for m, b in both], [1.0] * len(both), [f"{m.plans}/{m.building}" for m, _ in both])
    return None if gain is None else (gain, len(both))


def gap_closed(rows: Sequence[Row], method: str) -> float | None:
    """(F1 - voting) / (oracle - voting) over the pairs that all three were asked; None where the gap is small."""
    both = _both(rows, (method, BASE, ORACLE))
    if not both:
        return None
    own, base, oracle = (sum(f1(r) for r in column) / len(both) for column in zip(*both, strict=True))
    return (own - base) / (oracle - base) if oracle - base >= LEAST_GAP else None


def _both(rows: Sequence[Row], methods: Sequence[str]) -> list[tuple[Row, ...]]:
    by_pair: dict[Any, dict[str, Row]] = {}
    for row in rows:
        by_pair.setdefault(row.key[1:], {})[row.method] = row
    return [tuple(of[m] for m in methods) for of in by_pair.values() if all(m in of for m in methods)]
