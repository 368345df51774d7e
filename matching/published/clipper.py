"""CLIPPER: the densest set of pairs that agree with one another.

P. C. Lusk, K. Fathian, J. P. How: CLIPPER: A Graph-Theoretic Framework for Robust Data Association. ICRA 2021.
max u'Mu over unit u >= 0 with u_i u_j = 0 where i and j contradict each other (M_ij = 0): projected gradient ascent
of u'(M - d C)u, C marking contradictions, with d raised until none is left.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from matching.arrays import Index

LEAST_SCORE = 0.85  # of a set of pairs, as in the released matcher
MOST_ASSIGNMENTS, MOST_AFFINITIES = 4096, 1 << 20  # that are computed at once

# of the ascent
INNER, OUTER = 200, 1000  # iterations at most: steps for one d, and values of d
STEP_TOLERANCE, VALUE_TOLERANCE, ZERO = 1e-8, 1e-9, 1e-9
BACKTRACK, MOST_BACKTRACKS = 0.25, 99  # a step that loses is cut to a quarter

Pairs = tuple[tuple[int, int], ...]  # (S, A) rows


@dataclass(frozen=True)
class Deadline:
    """The time at which the search stops, by `time.perf_counter()`."""

    at: float

    def check(self) -> None:
        """Raises TimeoutError."""
        if time.perf_counter() > self.at:
            raise TimeoutError


def assignments(s: int, a: int, fits: NDArray[np.bool_] | None = None) -> Iterator[Index]:
    """Yields all ways to assign s data different ones of a data, (B, s) at a time; none if s is more than a.

    With `fits` (a, s), only those whose pairs all fit.
    """
    every = itertools.chain.from_iterable(itertools.permutations(range(a), s))
    chunk = min(MOST_ASSIGNMENTS, max(1, MOST_AFFINITIES // max(s, 1) ** 2))
    for _ in range(-(-math.perm(a, s) // chunk) if s else 0):
        of_a = np.fromiter(itertools.islice(every, chunk * s), dtype=np.int64).reshape(-1, s)
        yield of_a if fits is None else of_a[fits[of_a, np.arange(s)].all(axis=1)]


def agreeing_sets(assigned: Iterator[Index], affinity: Callable[[Index], Array], deadline: Deadline) -> list[Pairs]:
    """Returns the largest sets of pairs within the assignments whose score is above `LEAST_SCORE`, each once, in order
    of finding.

    `affinity` maps (B, n), the A data of the n S data, to (B, n, n) affinities in [0, 1], 1 on the diagonal. Raises
    TimeoutError.
    """
    rng = np.random.default_rng(0)  # the publication takes any seed; a fixed one gives the same answer each time
    found: dict[Pairs, None] = {}
    longest = 0
    for of_a in assigned:
        deadline.check()
        value, chosen = densest(affinity(of_a), rng, deadline)
        size = chosen.sum(axis=1)
        score = value / np.maximum(size, 1)
        longest = max(longest, int(size[score > LEAST_SCORE].max(initial=0)))
        for k in np.nonzero((score > LEAST_SCORE) & (size == longest))[0]:
            at = np.nonzero(chosen[k])[0]
            found[tuple(zip(at.tolist(), of_a[k, at].tolist(), strict=True))] = None
    return [pairs for pairs in found if len(pairs) == longest > 0]


def densest(M: Array, rng: np.random.Generator, deadline: Deadline) -> tuple[Array, NDArray[np.bool_]]:
    """Solves B problems of (B, n, n) affinities from random starts.

    Returns u'Mu (B,), and which of the n pairs are chosen (B, n): the largest entries of u, as many as the value.
    Raises TimeoutError.
    """
    u = _unit(_times(M, rng.random(M.shape[:2])))
    contradicts = (M == 0).astype(float)
    d = _penalty(M, contradicts, u)
    value = np.zeros(len(M))
    left = np.arange(len(M))
    for _ in range(OUTER):
        value[left], u[left] = _climb(M[left] - d[left, None, None] * contradicts[left], u[left], deadline)
        more = _penalty(M[left], contradicts[left], u[left])
        d[left] += more
        left = left[more > 0]
        if not len(left):
            break
    rank = np.argsort(np.argsort(-u, axis=1, kind="stable"), axis=1)
    return value, rank < np.round(value)[:, None]


def _climb(Md: Array, u: Array, deadline: Deadline) -> tuple[Array, Array]:
    """Projected gradient ascent of u'Md u on the part u >= 0 of the unit sphere."""
    value = np.sum(u * _times(Md, u), axis=1)
    left = np.arange(len(Md))
    for _ in range(INNER):
        deadline.check()
        now, own, before = u[left], Md[left], value[left]
        gradient = _times(own, now)
        step = np.ones(len(left))
        for _ in range(MOST_BACKTRACKS):
            new = _unit(np.maximum(now + step[:, None] * gradient, 0.0))
            after = np.sum(new * _times(own, new), axis=1)
            lost = after < before - VALUE_TOLERANCE
            if not lost.any():
                break
            step[lost] *= BACKTRACK
        u[left], value[left] = new, after
        moved = np.linalg.norm(new - now, axis=1) >= STEP_TOLERANCE
        left = left[moved & (np.abs(after - before) >= VALUE_TOLERANCE)]
        if not len(left):
            break
    return value, u


def _penalty(M: Array, contradicts: Array, u: Array) -> Array:
    """(B,) by how much d is to be raised; 0 if no contradiction is left."""
    against = _times(contradicts, u)
    at = (against > ZERO) & (u > ZERO)
    ratio = np.where(at, _times(M, u) / np.where(at, against, 1.0), 0.0)
    return np.asarray(np.abs(ratio.sum(axis=1) / np.maximum(at.sum(axis=1), 1)))


def _times(M: Array, u: Array) -> Array:
    return np.asarray(np.matmul(M, u[..., None])[..., 0])


def _unit(u: Array) -> Array:
    return np.asarray(u / np.maximum(np.linalg.norm(u, axis=-1, keepdims=True), 1e-300))
