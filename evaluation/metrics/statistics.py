"""Statistics of errors, and scores of counts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError


@dataclass(frozen=True)
class Statistics:
    """Statistics of error magnitudes, in their unit."""

    rmse: float
    median: float
    max: float

    @staticmethod
    def of(values: NDArray[np.float64]) -> "Statistics":
        """The statistics of the magnitudes of (N,) values. Raises UserError if there are none or one is not finite."""
        size = np.abs(values)
        if not len(size) or not np.isfinite(size).all():
            raise UserError(f"no statistics of {len(size)} errors: there must be one, and all must be finite")
        return Statistics(float(np.sqrt(np.mean(size**2))), float(np.median(size)), float(size.max()))


@dataclass(frozen=True)
class Score:
    """Counts of answers: `right` of the `answered` are true, `found` of the `expected` were found."""

    right: int
    answered: int
    found: int
    expected: int

    @property
    def precision(self) -> float | None:
        """The share of right answers; None without answers."""
        return self.right / self.answered if self.answered else None

    @property
    def recall(self) -> float | None:
        """The share of the expected items that was found; None if nothing was expected."""
        return self.found / self.expected if self.expected else None

    @property
    def f1(self) -> float | None:
        """The harmonic mean of precision and recall: 0 without answers, None if nothing was expected."""
        precision, recall = self.precision or 0.0, self.recall
        if recall is None:
            return None
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0
