"""The statistics that every error is told by."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError


@dataclass(frozen=True)
class Statistics:
    """Of errors' magnitudes, in their unit; `std` is that of the sample about its mean (divided by N)."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float

    @staticmethod
    def of(values: NDArray[np.float64]) -> "Statistics":
        """Of the magnitudes of (N,) values; raises UserError where there is none or one is not finite."""
        size = np.abs(values)
        if not len(size) or not np.isfinite(size).all():
            raise UserError(f"no statistics of {len(size)} errors: there must be one, and all must be finite")
        return Statistics(
            float(np.sqrt(np.mean(size**2))), float(size.mean()), float(np.median(size)), float(size.std()),
            float(size.min()), float(size.max()),
        )  # fmt: skip


@dataclass(frozen=True)
class Score:
    """Of `answered`, `right` are true; of `expected`, `found` were found. A share of nothing is None."""

    right: int
    answered: int
    found: int
    expected: int

    @property
    def precision(self) -> float | None:
        """The share of the answers that is right."""
        return self.right / self.answered if self.answered else None

    @property
    def recall(self) -> float | None:
        """The share of what was to be found that was."""
        return self.found / self.expected if self.expected else None

    @property
    def f1(self) -> float | None:
        """The harmonic mean of precision and recall: 0 where nothing was answered, None where nothing was expected."""
        precision, recall = self.precision or 0.0, self.recall
        if recall is None:
            return None
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0
