"""Sets of pairs that agree, found by trying every way to assign each S datum a different A datum."""

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from data.geometry.se2 import Array
from matching.arrays import Index
from matching.combinatorial.clipper import densest

CHUNK, ENTRIES = 4096, 1 << 20  # injections tried at once, and their affinities, at most
Affinity = Callable[[Index], Array]  # (B, n) A datums of the n S datums -> (B, n, n), 1 on the diagonal
Pairs = tuple[tuple[int, int], ...]  # (S, A)


class TimeIsUpError(Exception):
    """The search exceeded its time limit."""


@dataclass(frozen=True)
class Clock:
    """Stops the search at its time limit."""

    began: float
    limit_s: float

    def check(self) -> None:
        """Raises TimeIsUpError."""
        if time.perf_counter() - self.began > self.limit_s:
            raise TimeIsUpError


@dataclass(frozen=True)
class AgreeingSet:
    """Pairs that agree, and their score: 1 if entirely."""

    pairs: Pairs
    score: float


def agreeing_sets(
    injections: Iterator[Index], affinity: Affinity, least: float, restarts: int, clock: Clock
) -> list[AgreeingSet]:
    """Returns the largest sets of pairs within the injections whose score is above `least`, each once, in order of
    finding.

    Raises TimeIsUpError.
    """
    rng = np.random.default_rng(0)  # published: any seed; ours: the same answer to the same question
    found: dict[Pairs, float] = {}
    longest = 0
    for of_a in injections:
        clock.check()
        M = affinity(of_a)
        taken = of_a >= 0
        M = np.where(taken[:, :, None] & taken[:, None, :], M, 0.0)
        dense = densest(M, rng, restarts, clock.check)
        size, score = dense.chosen.sum(axis=1), dense.score
        longest = max(longest, int(size[score > least].max(initial=0)))
        for k in np.nonzero((score > least) & (size == longest))[0]:
            at = np.nonzero(dense.chosen[k])[0]
            found.setdefault(tuple(zip(at.tolist(), of_a[k, at].tolist(), strict=True)), float(score[k]))
    return [AgreeingSet(pairs, score) for pairs, score in found.items() if len(pairs) == longest and longest > 0]


def injections(s: int, a: int, fits: Array | None = None, partial: bool = False) -> Iterator[Index]:
    """Yields all ways to assign s datums different ones of a datums, (B, s) at a time; none if s is more than a.

    With `fits` (a, s), only those whose pairs all fit; if `partial`, all, with -1 in place of pairs that do not fit.
    """
    every = itertools.chain.from_iterable(itertools.permutations(range(a), s))
    chunk = min(CHUNK, max(1, ENTRIES // max(s, 1) ** 2))
    for _ in range(-(-math.perm(a, s) // chunk) if s else 0):
        of_a = np.fromiter(itertools.islice(every, chunk * s), dtype=np.int64).reshape(-1, s)
        if fits is not None:
            fit = fits[of_a, np.arange(s)]
            of_a = np.unique(np.where(fit, of_a, -1), axis=0) if partial else of_a[fit.all(axis=1)]
        yield of_a
