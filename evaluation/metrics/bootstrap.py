"""Confidence intervals of shares and means by bootstrap over buildings, and the bound of a rare event's share."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


def ratio(numerator: ArrayLike, denominator: ArrayLike, cluster: Sequence[Hashable]) -> Estimate | None:
    """The ratio of two sums over (N,) pairs, with the percentile interval of Efron's bootstrap over clusters.

    Pairs of one building are not independent, so buildings (`cluster`, N names) are resampled with all of their pairs;
    with a single building, its pairs are resampled. For a mean over pairs the denominators are ones. None if the
    denominators sum to zero.
    """
    sums = np.stack((np.asarray(numerator, dtype=float), np.asarray(denominator, dtype=float)), axis=1)
    if not len(sums) or sums[:, 1].sum() <= 0:
        return None
    names, of = np.unique(np.asarray(cluster), return_inverse=True)
    if len(names) > 1:
        sums = np.stack([np.bincount(of, column) for column in sums.T], axis=1)
    drawn = _times(len(sums)) @ sums
    drawn = drawn[drawn[:, 1] > 0]
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(drawn[:, 0] / drawn[:, 1], (tail, 100 - tail))
    total = sums.sum(axis=0)
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
