"""Calibration of confidences: bins of answers by confidence, and the expected calibration error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.common.errors import UserError

BINS = 20


@dataclass(frozen=True)
class Bin:
    """The answers with a confidence in [index, index + 1) / 20 (1 is in the last bin): their number, the number of
    right ones, and the sum of their confidences."""

    index: int
    count: int
    right: int
    confidence: float

    @property
    def mean(self) -> float:
        """The mean confidence."""
        return self.confidence / self.count

    @property
    def share(self) -> float:
        """The share that is right."""
        return self.right / self.count


def binned(confidences: Sequence[float], right: Sequence[bool]) -> tuple[Bin, ...]:
    """The non-empty bins. Raises UserError for a confidence outside [0, 1]."""
    value = np.asarray(confidences, dtype=float)
    if not ((value >= 0) & (value <= 1)).all():
        raise UserError("matches: a confidence is not in [0, 1]; correct the matcher")
    at = np.minimum((value * BINS).astype(int), BINS - 1)
    hit = np.asarray(right, dtype=float)
    count, good, total = (np.bincount(at, w, BINS) for w in (np.ones(len(value)), hit, value))
    return tuple(Bin(k, int(count[k]), int(good[k]), float(total[k])) for k in range(BINS) if count[k])


def calibration_error(bins: tuple[Bin, ...]) -> float | None:
    """The mean over all answers of |mean confidence - share that is right| of their bin (M. P. Naeini, G. F. Cooper
    and M. Hauskrecht, AAAI 2015); None without answers."""
    count = sum(b.count for b in bins)
    return sum(abs(b.confidence - b.right) for b in bins) / count if count else None
