"""How long answers took, in whole milliseconds, so that a long drive takes no more memory than a short one."""

from collections import Counter
from typing import Any


class Latencies:
    """Counts answers by their milliseconds, and the most scans that ever waited."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self._longest, self._most_waiting = 0.0, 0

    def add(self, seconds: float, waiting: int) -> None:
        """Adds an answer."""
        self._counts[round(seconds * 1000)] += 1
        self._longest = max(self._longest, seconds)
        self._most_waiting = max(self._most_waiting, waiting)

    @property
    def answers(self) -> int:
        """How many there were."""
        return self._counts.total()

    def percentile_ms(self, percent: float) -> int | None:
        """The milliseconds within which so many of the answers came; None before the first."""
        wanted, seen = self._counts.total() * percent / 100, 0
        for milliseconds in sorted(self._counts):
            seen += self._counts[milliseconds]
            if seen >= wanted:
                return milliseconds
        return None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for metrics.json."""
        return {
            "answers": self.answers, "p50_ms": self.percentile_ms(50), "p99_ms": self.percentile_ms(99),
            "longest_ms": round(1000 * self._longest), "most_waiting": self._most_waiting,
        }  # fmt: skip
