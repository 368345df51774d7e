"""Aligns the heights of a floor's level surfaces to those of the plan: floors to the storey's, ceilings to its walls'.

What hides a floor lies above it, like furniture and platforms, and what hides a ceiling lies below it. So a surface
below the planned floor, or above the planned ceilings, speaks against a height more than another one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring.wall_alignment import AlignedWall
from sgslam.config import AnchorSettings
from sgslam.mapping.level_map import Levels

Floats = NDArray[np.float64]
# densities (1/m): what is seen from above is at the planned floor, above it (within 2 m), or below it; what is seen
# from below is at a planned ceiling, below it (within 1.5 m), or above it
_FLOOR = 0.8, 0.19 / 2.0, 0.01 / 1.0
_CEILING = 0.5, 0.45 / 1.5, 0.05
_CARRIED = 1.2, 0.6  # m above the floor, mean and standard deviation, of sensors: robots' 0.4, hands' 1.4, poles' 2
_SURE, _NORMAL = 0.95, 1.96  # probability of a height that is not doubted; sigmas of a normal distribution that hold it
_AREA = 10.0  # m2, times keyframes, of a level surface that counts for half


@dataclass(frozen=True)
class HeightAlignment:
    """The planned heights (m, local frame) of level surfaces by their numbers.

    `raised` (m) is that of the levelled map's z = 0. `sigma` (m) is the standard deviation of what they have in common,
    such that 95 % regions hold at least 95 % of the probability: 0 where no other height is likely.
    """

    planned: dict[int, float]
    raised: float
    sigma: float


def align_heights(
    levels: Levels, walls: list[AlignedWall], floor: float, origin: float, sensor: float, settings: AnchorSettings
) -> HeightAlignment | None:
    """The heights of level surfaces in the plan; None where none fits.

    `walls` are the floor's aligned walls, `floor` is the height (m) of the planned floor in the local frame, which is
    the BIM frame moved down by `origin` (m). `sensor` (m) is the usual height of the sensor in the levelled map.
    """
    tops = {w.planned.height[1] - origin for w in walls if w.planned.height is not None}
    ceilings = np.array(sorted(top for top in tops if top > floor + 1.0))
    to_ceilings = ceilings[:, None] - levels.height[~levels.is_floor]
    candidates = np.concatenate([floor - levels.height[levels.is_floor], to_ceilings.ravel()])
    if not len(candidates):
        return None
    odds = np.array([_log_odds(levels, raised, floor, ceilings, settings.tolerance) for raised in candidates.tolist()])
    odds -= ((candidates + sensor - floor - _CARRIED[0]) / _CARRIED[1]) ** 2 / 2
    distinct = distinct_heights(candidates, odds, settings.tolerance)
    likely = np.exp(odds[distinct] - odds[distinct[0]])
    best, apart = distinct[0], np.abs(candidates[distinct[1:]] - candidates[distinct[0]])
    sigma = height_sigma(apart, likely[1:] / likely.sum())
    planned = _planned(levels, float(candidates[best]), floor, ceilings, settings.tolerance)
    row = {int(level): k for k, level in enumerate(levels.ids)}
    off = [z - levels.height[row[level]] for level, z in planned.items()]
    return HeightAlignment(planned, float(np.mean(off)), sigma)


def distinct_heights(candidates: Floats, odds: Floats, tolerance: float) -> list[int]:
    """The likeliest of the heights (N,) within a tolerance (m) of one another, by their log odds; the first one first.

    Several surfaces may propose the same height, which is no likelier for that.
    """
    found: list[int] = []
    for k in np.argsort(-odds, kind="stable").tolist():
        if all(abs(candidates[k] - candidates[other]) > tolerance for other in found):
            found.append(k)
    return found


def height_sigma(apart: Floats, probability: Floats) -> float:
    """The standard deviation (m) of a height, where others that are so far `apart` (N,) have a probability (N,)."""
    if probability.sum() <= 1 - _SURE:
        return 0.0
    farthest = np.argsort(-apart)
    beyond = np.cumsum(probability[farthest])
    quantile = float(apart[farthest[np.argmax(beyond > 1 - _SURE)]])
    return max(quantile / _NORMAL, float(np.sqrt(probability @ apart**2)))


def _log_odds(levels: Levels, raised: float, floor: float, ceilings: Floats, tolerance: float) -> float:
    """The log likelihood of the level surfaces if the levelled map is so high, up to a constant."""
    height = levels.height + raised
    weight = levels.area / (levels.area + _AREA)
    above = height - floor
    of_floors = _mixture(above[:, None], above > 0, _FLOOR, tolerance)
    total = float(weight[levels.is_floor] @ of_floors[levels.is_floor])
    if not len(ceilings):
        return total
    of_ceilings = _mixture(height[:, None] - ceilings, height < ceilings.max(), _CEILING, tolerance)
    return total + float(weight[~levels.is_floor] @ of_ceilings[~levels.is_floor])


def _mixture(off: Floats, hiding: NDArray[np.bool_], parts: tuple[float, float, float], sigma: float) -> Floats:
    """(N,) log density of surfaces that are `off` (N, P), in metres, P planned ones, one of which they may be, or on
    the side of what may hide these, or not."""
    planned, hides, beyond = parts
    peaks = np.exp(-((off / sigma) ** 2) / 2) / (sigma * np.sqrt(2 * np.pi))
    return np.asarray(np.log(planned * peaks.mean(axis=1) + np.where(hiding, hides, beyond)))


def _planned(levels: Levels, raised: float, floor: float, ceilings: Floats, tolerance: float) -> dict[int, float]:
    """The planned height of each floor that is as planned; of each ceiling, where no floor is."""
    height, of_floor = levels.height + raised, levels.is_floor
    found = np.flatnonzero(of_floor & (np.abs(height - floor) < tolerance))
    if len(found):
        return {int(levels.ids[k]): floor for k in found}
    planned = {int(k): float(ceilings[np.argmin(np.abs(ceilings - height[k]))]) for k in np.flatnonzero(~of_floor)}
    return {int(levels.ids[k]): z for k, z in planned.items() if abs(z - height[k]) < tolerance}
