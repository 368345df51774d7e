"""The noise that the residuals of a factor graph show, by kinds of measurements: variance components."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_BELIEVED = 3.0  # residuals of the assumed noise, added to a kind's own
_SAMPLED = 100  # residuals of a kind for which it is computed how far they were fitted
_MOST_FITTED = 0.9  # share of a kind's residuals
_LIMITS = 0.15, 3.0  # of the noise shown, relative to the assumed one
_ROUNDS = 5  # of weights and noise in turns
_SAME = {
    1: (0,),
    3: (0, 1, 2),
    6: (0, 0, 0, 1, 1, 1),
}  # which components of planes (turn, tilt, offset) and of poses are alike


@dataclass(eq=False)
class _Kind:
    """The rows of the residuals of one kind, whitened and without weights, and the length of each one's whole
    residual, by which a robust loss weighs it."""

    loss: Any
    rows: list[int] = field(default_factory=list)
    residuals: list[float] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)

    def noise(self, fitted: float) -> float:
        """The standard deviation that the residuals show, of which a share was `fitted`."""
        squares, lengths, free = np.square(self.residuals), np.array(self.lengths), 1 - min(fitted, _MOST_FITTED)
        scale = 1.0
        for _ in range(_ROUNDS if self.loss is not None else 1):
            weights = np.ones(len(lengths)) if self.loss is None else self._weights(lengths / scale)
            variance = (weights @ squares + _BELIEVED) / (weights.sum() * free + _BELIEVED)
            scale = float(np.clip(np.sqrt(variance), *_LIMITS))
        return scale

    def _weights(self, lengths: Floats) -> Floats:
        return np.array([self.loss.weight(length) for length in lengths])


def noise_shown(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, jacobian: Any, solve: Callable[[Floats], Floats]
) -> Floats:
    """(M,) the standard deviation of each whitened residual (M,), as all of its kind show it (Foerstner 1979).

    A kind are the same components of factors of the same kinds of variables and of the same noise model. The `jacobian`
    (M, N) is that of the whitened, weighted residuals, and `solve` solves its normal equations. Steps with an excess
    covariance keep their assumed noise, because their residuals are always small.
    """
    scale = np.ones(jacobian.shape[0])
    for kind in _kinds(graph, values):
        chosen = np.unique(np.linspace(0, len(kind.rows) - 1, min(len(kind.rows), _SAMPLED)).astype(int))
        rows = jacobian[np.array(kind.rows)[chosen]]
        used = np.unique(rows.indices)
        known = solve(np.asfortranarray(rows.toarray().T))
        fitted = float(np.einsum("ij,ji->", rows[:, used].toarray(), known[used]))
        lengths = np.array(kind.lengths)[chosen]
        weights = len(chosen) if kind.loss is None else sum(kind.loss.weight(length) for length in lengths)
        scale[kind.rows] = kind.noise(fitted / max(weights, 1e-9))
    return scale


def _kinds(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> list[_Kind]:
    """All kinds, without the steps that keep their noise."""
    kinds, row = dict[tuple[str, str, int], _Kind](), 0
    for i in range(graph.size()):
        factor: Any = graph.at(i)  # gtsam's stubs know only its base class
        first, row = row, row + factor.dim()
        letters = "".join(sorted({chr(gtsam.symbolChr(key)) for key in factor.keys()}))  # noqa: SIM118 (no dict)
        if isinstance(factor, gtsam.LinearContainerFactor):
            noise, is_robust, base = None, False, None
            whole = np.asarray(factor.linearize(values).jacobian()[1])
        else:
            noise = factor.noiseModel()
            is_robust = isinstance(noise, gtsam.noiseModel.Robust)
            base = noise.noise() if is_robust else noise
            if not isinstance(base, gtsam.noiseModel.Diagonal):
                continue
            whole = base.whiten(factor.unwhitenedError(values))
        length = float(np.linalg.norm(whole))
        for part, same in enumerate(_SAME[factor.dim()]):
            key = letters, type(base).__name__, same
            kind = kinds.setdefault(key, _Kind(noise.robust() if noise is not None and is_robust else None))
            kind.rows.append(first + part)
            kind.residuals.append(float(whole[part]))
            kind.lengths.append(length)
    return list(kinds.values())
