"""Aligns the level surfaces of a mapped floor to the planned ones above and below which they lie in plan view.

What hides a planned floor lies on it, like furniture and platforms. Ceilings are hung that no plan shows, and planned
ones are missing. The larger a surface is, the less likely it is something else.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from data import LevelSurface
from sgslam.config import AnchorSettings
from sgslam.config.sensor import BUILDING
from sgslam.mapping.level_map import Levels

Floats = NDArray[np.float64]
_SURE, _NORMAL = 0.95, 1.96  # probability of a height that is not doubted; sigmas of a normal distribution that hold it
_MAPPED = 0.01  # m, standard deviation of a height within the map of a floor
_STEP = _MAPPED / 2  # m between the heights that are tried
ALIKE = 3 * _MAPPED  # m: surfaces as near in height are one, such as the ceilings of several rooms
_HIDING = 5.0  # m2, of a surface that is as likely to be furniture or a duct as the floor or ceiling
_REACH = BUILDING.cupboard  # m from a planned surface, within which others may hide it
_HUNG = 0.2  # share of ceilings that are not planned, or hang where a planned one is missing, however large
_BELOW = 0.1  # times as likely as one on the planned floor is one below it
_LEAST = 1e-6  # 1/m, density of what no model explains


@dataclass(frozen=True)
class LevelAlignment:
    """The planned heights (m, local frame) of level surfaces by their numbers, and their standard deviations (m).

    `raised` (m) is the height of the levelled map's z = 0. `sigma` (m) is that of what all of them have in common, so
    that 95 % regions hold at least 95 % of the probability: 0 where no other height is likely.
    """

    planned: dict[int, tuple[float, float]]
    raised: float
    sigma: float


class _Seen(NamedTuple):
    """A mapped surface: its number, height (m) and area (m2), and whether it is a floor; the heights (P,), m, of the
    planned ones where it lies in plan view, the share (P,) of it that lies there, and the standard deviation (m)."""

    number: int
    height: float
    area: float
    is_floor: bool
    planned: Floats
    share: Floats
    sigma: float

    @property
    def hides(self) -> float:
        """The probability that it is not the planned one."""
        small = 1 / (1 + (self.area / _HIDING) ** 2)
        return small if self.is_floor else max(small, _HUNG)

    def density(self, raised: Floats, sigma: float) -> Floats:
        """(R,) the density (1/m) of its height if the map is so high, where planned ones are known to `sigma` (m);
        what lies at no planned one may be anywhere."""
        above = (self.height + raised)[:, None] - self.planned
        other = self.hides / _REACH * (np.where(above > 0, 1.0, _BELOW) if self.is_floor else 0.5)
        planned = (1 - self.hides) * _normal(above, sigma)
        anywhere = max(1 - self.share.sum(), 0.0) / (2 * _REACH)
        return np.asarray((planned + other) @ self.share + anywhere + _LEAST)

    def planned_at(self, raised: float) -> float | None:
        """The planned height (m) of it if the map is so high; None where it probably is not the planned surface."""
        sigma = float(np.hypot(self.sigma, _MAPPED))
        likely = self.share * (1 - self.hides) * _normal(self.height + raised - self.planned, sigma)
        if max(likely, default=0.0) < 0.5 * self.density(np.array([raised]), sigma)[0]:
            return None
        return float(self.planned[np.argmax(likely)])


def align_levels(
    levels: Levels, planned: Sequence[LevelSurface], T_bim_level: Floats, origin: float, settings: AnchorSettings
) -> LevelAlignment | None:
    """The heights of mapped level surfaces in the plan; None where none lies at a `planned` one.

    `T_bim_level` (4, 4) places the levelled map in plan view; the heights returned are those in the local frame, the
    BIM frame moved down by `origin` (m).
    """
    seen = _at_planned(levels, planned, T_bim_level, origin, settings)
    proposed = np.concatenate([np.empty(0), *(own.planned - own.height for own in seen)])
    if not len(proposed):
        return None
    raised = np.arange(proposed.min() - _REACH / 4, proposed.max() + _REACH / 4, _STEP)
    likelihood = [_likelihood([own for own in _joined(seen) if own.is_floor == side], raised) for side in (True, False)]
    probability = np.prod(likelihood, axis=0)
    probability /= probability.sum()
    near = np.abs(raised - raised[np.argmax(probability)]) < 2 * ALIKE
    best = float(np.average(raised[near], weights=probability[near]))
    sigma = height_sigma(np.abs(raised[~near] - best), probability[~near])
    found = [(own, z) for own in seen if (z := own.planned_at(best)) is not None]
    # floors err together, ceilings likewise, and all of them by sigma
    count = Counter(own.is_floor for own, _ in found)
    variance = [own.sigma**2 * count[own.is_floor] for own, _ in found]
    shared = 1 + sigma**2 * sum(1 / v for v in variance)
    heights = {own.number: (z, float(np.sqrt(v * shared))) for (own, z), v in zip(found, variance, strict=True)}
    return LevelAlignment(heights, best, sigma)


def _at_planned(
    levels: Levels, planned: Sequence[LevelSurface], T_bim_level: Floats, origin: float, settings: AnchorSettings
) -> list[_Seen]:
    found = []
    polygons = [shapely.Polygon(surface.polygon, surface.holes) for surface in planned]
    for k, (number, places, is_floor) in enumerate(zip(levels.ids, levels.places, levels.is_floor, strict=True)):
        xy = places[:, :2] @ T_bim_level[:2, :2].T + T_bim_level[:2, 3]
        at: dict[float, float] = {}
        for surface, polygon in zip(planned, polygons, strict=True):
            within = shapely.contains_xy(polygon, *xy.T) if surface.is_floor == is_floor else np.zeros(len(xy), bool)
            if within.any():
                height = round(surface.height(*xy[within].mean(axis=0)) - origin, 3)
                at[height] = at.get(height, 0.0) + float(within.mean())
        sigma = settings.sigma_floor if is_floor else settings.sigma_ceiling
        share = np.array(list(at.values()))
        own = np.array(list(at)), share / max(1.0, share.sum())  # under a gallery lies another floor
        found.append(_Seen(int(number), float(levels.height[k]), float(levels.area[k]), bool(is_floor), *own, sigma))
    return found


def _joined(seen: list[_Seen]) -> list[_Seen]:
    """The surfaces, with those of one side and height taken as one: what is wrong about one is so about all."""
    joined: list[_Seen] = []
    for own in sorted(seen, key=lambda own: (own.is_floor, own.height)):
        last = joined[-1] if joined else None
        if last is None or last.is_floor != own.is_floor or own.height - last.height > ALIKE:
            joined.append(own)
            continue
        area = last.area + own.area
        height = (last.area * last.height + own.area * own.height) / area
        share = np.concatenate([last.share * last.area, own.share * own.area]) / area
        planned = np.concatenate([last.planned, own.planned])
        joined[-1] = own._replace(height=height, area=area, planned=planned, share=share)
    return joined


def _likelihood(seen: list[_Seen], raised: Floats) -> Floats:
    """(R,) that of all floors, or of all ceilings, if the map is so high, up to a factor: they were built off their
    planned heights together."""
    if not seen:
        return np.ones(len(raised))
    odds = np.sum([np.log(own.density(raised, _MAPPED)) for own in seen], axis=0)
    shared = gaussian_filter1d(np.exp(odds - odds.max()), seen[0].sigma / _STEP, mode="constant")
    return np.asarray(np.maximum(shared / shared.max(), _LEAST))


def _normal(off: Floats, sigma: float) -> Floats:
    return np.asarray(np.exp(-((off / sigma) ** 2) / 2) / (sigma * np.sqrt(2 * np.pi)))


def height_sigma(apart: Floats, probability: Floats) -> float:
    """The standard deviation (m) of a height, where others that are so far `apart` (N,) have a probability (N,)."""
    if probability.sum() <= 1 - _SURE:
        return 0.0
    farthest = np.argsort(-apart)
    beyond = np.cumsum(probability[farthest])
    quantile = float(apart[farthest[np.argmax(beyond > 1 - _SURE)]])
    return max(quantile / _NORMAL, float(np.sqrt(probability @ apart**2)))
