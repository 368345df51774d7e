"""The densest set of pairs that all agree, for many small problems at once.

P. C. Lusk, K. Fathian, J. P. How: CLIPPER: A Graph-Theoretic Framework for Robust Data Association. ICRA 2021.
max u'Mu over unit u >= 0 with u_i u_j = 0 where i and j contradict each other (M_ij = 0): projected gradient ascent
of u'(M - d C)u, C marking contradictions, with d raised until none is left.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array

INNER, OUTER = 200, 1000
STEP_TOLERANCE, VALUE_TOLERANCE, ZERO = 1e-8, 1e-9, 1e-9
BACK, MOST_BACK = 0.25, 99  # a step that loses is cut to a quarter


@dataclass(frozen=True)
class Dense:
    """Solutions of B problems: `value` u'Mu (B,), and which of the n pairs are `chosen` (B, n), as many as the
    value.
    """

    value: Array
    chosen: NDArray[np.bool_]

    @property
    def score(self) -> Array:
        """(B,) the value per chosen pair: 1 where all agree entirely."""
        return np.asarray(self.value / np.maximum(self.chosen.sum(axis=1), 1))


def densest(M: Array, rng: np.random.Generator, restarts: int = 1, check: Callable[[], None] = lambda: None) -> Dense:
    """Solves B problems of (B, n, n) affinities in [0, 1], 1 on the diagonal (0 for a pair that is excluded).

    Starts are random; the best of several is returned. `check` is called regularly and may raise to stop the search.
    """
    best = np.full(len(M), -np.inf)
    vector = np.zeros(M.shape[:2])
    for _ in range(restarts):
        value, u = _ascent(M, rng.random(M.shape[:2]), check)
        better = value > best
        best[better], vector[better] = value[better], u[better]
    rank = np.argsort(np.argsort(-vector, axis=1, kind="stable"), axis=1)
    return Dense(best, rank < np.round(best)[:, None])


def _ascent(M: Array, u: Array, check: Callable[[], None]) -> tuple[Array, Array]:
    """(B,) values and (B, n) vectors from the starts u."""
    contradicts = (M == 0).astype(float)
    u = _unit(_times(M, u))
    d = _penalty(M, contradicts, u)
    value = np.zeros(len(M))
    left = np.arange(len(M))
    for _ in range(OUTER):
        value[left], u[left] = _climb(M[left] - d[left, None, None] * contradicts[left], u[left], check)
        more = _penalty(M[left], contradicts[left], u[left])
        d[left] += more
        left = left[more > 0]
        if not len(left):
            break
    return value, u


def _climb(Md: Array, u: Array, check: Callable[[], None]) -> tuple[Array, Array]:
    """Projected gradient ascent of u'Md u on the part u >= 0 of the unit sphere."""
    value = np.sum(u * _times(Md, u), axis=1)
    left = np.arange(len(Md))
    for _ in range(INNER):
        check()
        now, own, before = u[left], Md[left], value[left]
        gradient = _times(own, now)
        step = np.ones(len(left))
        for _ in range(MOST_BACK):
            new = _unit(np.maximum(now + step[:, None] * gradient, 0.0))
            after = np.sum(new * _times(own, new), axis=1)
            lost = after < before - VALUE_TOLERANCE
            if not lost.any():
                break
            step[lost] *= BACK
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
