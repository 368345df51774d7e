"""Proposed matches of wall surfaces: how likely one of the map is one of the plan."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.se2 import Array
from matching.arrays import Index

MOST = 8  # proposals that are kept of one S surface or room


@dataclass(frozen=True)
class TopK:
    """The K likeliest A nodes of each of N S nodes, best first; small whatever the size of the plan.

    `partner` (N, K) are indices into A, -1 where there are fewer than K; `score` (N, K) are probabilities in [0, 1], 0
    where there is none. Rows may sum to less than 1: the rest is "not in the plan".
    """

    partner: Index
    score: Array

    @staticmethod
    def of_dense(score: NDArray[np.floating[Any]], most: int = MOST) -> "TopK":
        """Selects the best `most` of each row of scores (N, M). Raises UserError for scores outside [0, 1]."""
        score = np.asarray(score, dtype=float)
        if score.ndim != 2 or not ((score >= -1e-6) & (score <= 1 + 1e-6)).all():
            raise UserError("proposals: scores must be a table of probabilities in [0, 1]")
        most = min(most, score.shape[1])
        best = np.argsort(-score, axis=1, kind="stable")[:, :most]
        value = np.clip(np.take_along_axis(score, best, axis=1), 0.0, 1.0)
        return TopK(np.where(value > 0, best, -1), value)


def together(one: TopK, other: TopK) -> TopK:
    """Merges proposals of two sources for each S wall, best first; a pair that both propose counts once, by the higher
    of its scores."""
    partner, score = np.hstack((one.partner, other.partner)), np.hstack((one.score, other.score))
    order = np.argsort(-score, axis=1, kind="stable")
    partner, score = np.take_along_axis(partner, order, axis=1), np.take_along_axis(score, order, axis=1)
    again = np.tril(partner[:, :, None] == partner[:, None, :], -1).any(axis=2)
    return TopK(np.where(again, -1, partner), np.where(again, 0.0, score))
