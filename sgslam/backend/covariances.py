"""Marginal covariances of the factor graph, from its linearisation at the optimum.

The noise of each kind of measurement is the one that its residuals show (variance components). What anchors tell
together counts once: a wall that was built elsewhere takes all its faces along, and its rooms.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X
from numpy.typing import NDArray

from sgslam.backend.variables import BIM
from sgslam.mapping import PlannedWall

Floats = NDArray[np.float64]
_DIMENSIONS = {"p": 3, "f": 3, "u": 3, "v": 1}  # of planes and of walls' offsets; all other variables are poses
_BELIEVED = 3.0  # residuals of the assumed noise, and pairs of faces that stand off as one, added to those seen
_SAMPLED = 100  # residuals of a kind for which it is computed how far they were fitted
_MOST_FITTED = 0.9  # share of a kind's residuals
_LIMITS = 0.15, 3.0  # of the noise shown, relative to the assumed one
_ROUNDS = 5  # of weights and noise in turns
# which components of planes (turn, tilt, offset) and of poses are alike, by the number of components
_ALIKE = {1: (0,), 3: (0, 1, 2), 6: (0, 0, 0, 1, 1, 1)}
_NOTHING_NEW = 1e3  # times the standard deviation: it no longer counts


class Uncertainty:
    """Marginals of a graph at its optimum `values`; robust losses enter with their weights there.

    The noise of each kind of measurement (walls, floors, plan, ...) is the one that its residuals show. The information
    matrix is factored for them and again for the queries, each of which costs one sparse solution for each of its rows.
    `planned` gives, by the key of its frame, the planned wall of each anchor that is not loose; where it is None, the
    noise is the assumed one, which takes a tenth of the time. Raises RuntimeError where a variable is free.
    """

    def __init__(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, planned: Mapping[int, PlannedWall] | None
    ) -> None:
        from scipy.sparse import csc_matrix, diags

        self._values = values
        keys = sorted(set(graph.keyVector()))
        sizes = [_DIMENSIONS.get(chr(gtsam.symbolChr(key)), 6) for key in keys]
        starts = np.concatenate([[0], np.cumsum(sizes)]).tolist()
        self._columns = {key: slice(a, b) for key, a, b in zip(keys, starts[:-1], starts[1:], strict=True)}
        self._size = int(starts[-1])
        rows, columns, entries = graph.linearize(values).sparseJacobian_()
        rows, columns = rows.astype(np.int64) - 1, columns.astype(np.int64) - 1  # they count from one
        shape, of_jacobian = (int(rows.max()) + 1, self._size), columns < self._size  # the last column is the residual
        jacobian = csc_matrix((entries[of_jacobian], (rows[of_jacobian], columns[of_jacobian])), shape=shape)
        if planned is None:
            self._solve = _solver(jacobian)
            return
        scale = noise_shown(graph, values, jacobian.tocsr(), _solver(jacobian))
        first = np.cumsum([0, *(graph.at(i).dim() for i in range(graph.size()))])
        for index, larger in shared_offsets(graph, values, planned).items():
            scale[first[index] : first[index + 1]] *= larger
        self._solve = _solver(diags(1 / scale) @ jacobian)

    def pose_covariances(self, keyframes: list[int]) -> Floats:
        """(N, 6, 6) of T_bim_sensor (of T_map_sensor where the graph has no BIM frame), rotation first (rad), then
        translation (m), in the sensor's axes."""
        covariances = np.empty((len(keyframes), 6, 6))
        for covariance, keyframe in zip(covariances, keyframes, strict=True):
            J = np.zeros((6, self._size))  # one at a time: those of a long run would take a hundred megabytes
            J[:, self._columns[X(keyframe)]] = np.eye(6)
            if BIM in self._columns:
                T_map_local, T_map_sensor = self._values.atPose3(BIM), self._values.atPose3(X(keyframe))
                J[:, self._columns[BIM]] = -T_map_sensor.inverse().compose(T_map_local).AdjointMap()
            covariance[:] = J @ self._solve(np.asfortranarray(J.T))
        return np.asarray((covariances + covariances.transpose(0, 2, 1)) / 2)

    def variance(self, gradient: Mapping[int, Floats]) -> float:
        """Of a quantity with this gradient (6,) for each variable that is a pose, in the axes of that pose."""
        J = np.zeros(self._size)
        for key, own in gradient.items():
            J[self._columns[key]] = own
        return float(J @ self._solve(J))


def _solver(jacobian: Any) -> Callable[[Floats], Floats]:
    """Solves the normal equations of a sparse Jacobian. Raises RuntimeError where they are singular."""
    from scipy.sparse.linalg import splu

    normal = (jacobian.T @ jacobian).tocsc()
    solve: Callable[[Floats], Floats] = splu(normal, "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True}).solve
    return solve


def _letters(factor: Any) -> str:
    """The kinds of a factor's variables, by their letters."""
    return "".join(sorted({chr(gtsam.symbolChr(key)) for key in factor.keys()}))  # noqa: SIM118 (no dict)


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
            weights = self.weights(lengths / scale)
            variance = (weights @ squares + _BELIEVED) / (weights.sum() * free + _BELIEVED)
            scale = float(np.clip(np.sqrt(variance), *_LIMITS))
        return scale

    def weights(self, lengths: Floats) -> Floats:
        """(N,) those of whitened residuals of these lengths (N,)."""
        return np.array([1.0 if self.loss is None else self.loss.weight(length) for length in lengths])


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
        weights = sum(kind.weights(np.array(kind.lengths)[chosen]).tolist())
        scale[kind.rows] = kind.noise(fitted / max(weights, 1e-9))
    return scale


def _kinds(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> list[_Kind]:
    """All kinds, without the steps that keep their noise."""
    kinds, row = dict[tuple[str, str, int], _Kind](), 0
    for i in range(graph.size()):
        factor: Any = graph.at(i)  # gtsam's stubs know only its base class
        first, row = row, row + factor.dim()
        base: Any = None  # as above
        loss = None
        if isinstance(factor, gtsam.LinearContainerFactor):
            whole = np.asarray(factor.linearize(values).jacobian()[1])
        else:
            base = factor.noiseModel()
            if isinstance(base, gtsam.noiseModel.Robust):
                base, loss = base.noise(), base.robust()
            if not isinstance(base, gtsam.noiseModel.Diagonal):
                continue
            whole = base.whiten(factor.unwhitenedError(values))
        letters, length = _letters(factor), float(np.linalg.norm(whole))
        for part, same in enumerate(_ALIKE[factor.dim()]):
            kind = kinds.setdefault((letters, type(base).__name__, same), _Kind(loss))
            kind.rows.append(first + part)
            kind.residuals.append(float(whole[part]))
            kind.lengths.append(length)
    return list(kinds.values())


def shared_offsets(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, planned: Mapping[int, PlannedWall]
) -> dict[int, float]:
    """By the index of a factor in the graph: by how much the standard deviation of an anchor is larger than if each
    face of a wall stood off on its own, and each room on its own. `planned` has the planned wall of each robust anchor
    by the key of its frame.

    The offsets of n faces of one wall tell as much as n / (1 + (n - 1) rho) of them: rho is the intraclass correlation
    that the residuals of all walls show (Fisher 1925). Rooms are anchored by the same walls, and tell nothing new.
    """
    larger = dict[int, float]()
    faces: dict[str, list[tuple[int, Floats]]] = defaultdict(list)  # of each wall: factor, and offset as a vector
    for index in range(graph.size()):
        factor: Any = graph.at(index)  # gtsam's stubs know only its base class
        keys = list(factor.keys())
        if planned and _letters(factor) == "br":
            larger[index] = _NOTHING_NEW
        own = next((planned[key] for key in keys if key in planned), None)
        if own is not None and "p" in _letters(factor):
            error, noise = factor.unwhitenedError(values), factor.noiseModel()
            weight = noise.robust().weight(float(np.linalg.norm(noise.noise().whiten(error))))
            faces[own.wall or own.a_id or f"anchor {index}"].append((index, np.sqrt(weight) * error[2] * own.plane[:3]))
    rho = _correlation(list(faces.values()))
    for walls in faces.values():
        larger |= {index: float(np.sqrt(1 + (len(walls) - 1) * rho)) for index, _ in walls}
    return larger


def _correlation(faces: list[list[tuple[int, Floats]]]) -> float:
    """The intraclass correlation of the offsets of each wall's faces."""
    products, squares = 0.0, 0.0
    for walls in faces:
        for (_, one), (_, other) in combinations(walls, 2):
            share = 1.0 / (len(walls) - 1)  # each face counts once, however many there are
            products += share * float(one @ other)
            squares += share * float(one @ one + other @ other) / 2
    counted = sum(len(walls) / 2 for walls in faces if len(walls) > 1)
    believed = _BELIEVED * squares / counted if counted else 0.0
    return float(np.clip((products + believed) / (squares + believed), 0.0, 1.0)) if squares else 1.0
