"""Comparison of methods on the same pairs: difference of wall F1, and the share of the gap to the oracle it closes."""

from collections.abc import Sequence
from typing import Any

from evaluation.matching_benchmark.rows import ORACLE, Row
from evaluation.metrics.bootstrap import Estimate, ratio

BASE = "voting"
LEAST_GAP = 0.02  # of F1 between oracle and base, below which no share is given


def f1(row: Row) -> float:
    """F1 of the pair's walls; 1 if there was nothing to find and nothing was matched."""
    t = row.wall_tally
    return 2 * t.right / (t.answered + t.true) if t.answered + t.true else 1.0


def difference(rows: Sequence[Row], method: str, base: str) -> tuple[Estimate, int] | None:
    """The mean of F1(method) - F1(base) over their common pairs, with its interval by building, and the number of
    pairs; None without common pairs."""
    both = _both(rows, (method, base))
    if not both:
        return None
    gain = ratio([f1(m) - f1(b) for m, b in both], [1.0] * len(both), [f"{m.plans}/{m.building}" for m, _ in both])
    return None if gain is None else (gain, len(both))


def gap_closed(rows: Sequence[Row], method: str) -> float | None:
    """(F1 - voting) / (oracle - voting) over the common pairs of all three; None if the gap is small."""
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
