"""What anchors tell together: a wall that was built elsewhere takes all its faces along, and its rooms."""

from collections import defaultdict
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, P, R
from numpy.typing import NDArray

from sgslam.mapping import PlannedWall

Floats = NDArray[np.float64]
_NOTHING_NEW = 1e3  # times the standard deviation: it no longer counts
_OF_ROOMS = {gtsam.symbolChr(B(0)), gtsam.symbolChr(R(0))}
_BELIEVED = 3.0  # pairs of faces that stand off as one, added to those of the map


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
        if planned and {gtsam.symbolChr(key) for key in keys} == _OF_ROOMS:
            larger[index] = _NOTHING_NEW
        own = next((planned[key] for key in keys if key in planned), None)
        if own is not None and any(gtsam.symbolChr(key) == gtsam.symbolChr(P(0)) for key in keys):
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
