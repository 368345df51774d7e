"""Statistics of errors, scores of counts, intervals over buildings, and the calibration of confidences."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.common.errors import UserError

DRAWS = 2000
LEVEL = 0.95
BINS = 20


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


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; NaN where there is none."""

    value: float
    low: float
    high: float


def ratio(numerator: ArrayLike, denominator: ArrayLike, cluster: Sequence[Hashable], least: int = 5) -> Estimate | None:
    """The ratio of two sums over (N,) pairs, with the percentile interval of Efron's bootstrap over clusters.

    Pairs of one building are not independent, so buildings (`cluster`, N names) are resampled with all of their pairs.
    The interval is NaN with fewer than `least` buildings. For a mean over pairs the denominators are ones. None if the
    denominators sum to zero.
    """
    sums = np.stack((np.asarray(numerator, dtype=float), np.asarray(denominator, dtype=float)), axis=1)
    if not len(sums) or sums[:, 1].sum() <= 0:
        return None
    total = sums.sum(axis=0)
    names, of = np.unique(np.asarray(cluster), return_inverse=True)
    if len(names) < least:
        return Estimate(float(total[0] / total[1]), np.nan, np.nan)
    sums = np.stack([np.bincount(of, column) for column in sums.T], axis=1)
    drawn = _times(len(sums)) @ sums
    drawn = drawn[drawn[:, 1] > 0]
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(drawn[:, 0] / drawn[:, 1], (tail, 100 - tail))
    return Estimate(float(total[0] / total[1]), float(low), float(high))


@lru_cache(maxsize=32)
def _times(n: int) -> NDArray[np.float64]:
    """(DRAWS, n) how often each of n clusters is drawn; kept, since many cells have as many."""
    return np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), size=DRAWS).astype(float)


def upper_bound(count: int, of: int) -> float:
    """The exact 97.5 % upper bound of a share, given `count` of `of` (Clopper and Pearson, 1934).

    Unlike a bootstrap interval, it is meaningful for a count of zero.
    """
    from scipy.special import betaincinv  # slow to import

    return 1.0 if count >= of else float(betaincinv(count + 1, of - count, (1 + LEVEL) / 2))


@dataclass(frozen=True)
class Bin:
    """The answers with a confidence in [index, index + 1) / 20 (1 is in the last bin): their number, the number of
    right ones, and the sum of their confidences."""

    index: int
    count: int
    right: int
    confidence: float


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
