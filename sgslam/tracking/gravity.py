"""The vertical from the surfaces of a building: walls are upright, floors and ceilings level.

Most surfaces are parallel or perpendicular to the vertical, but in most buildings also to two other directions. Which
one is the vertical is decided by cues (`gravity_cues`), summed as log odds; which end is up, by the expected mount.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.tracking.gravity_cues import UprightView, axis_log_odds

Floats = NDArray[np.float64]
Mounts = tuple[tuple[float, float, float], ...]

FEWEST = 30  # surfels
DIRECTIONS = 6  # of surfaces that are looked at, the commonest first
LEAST_SHARE = 0.04  # of the surfaces that have one of these directions
SPREAD = float(np.cos(np.radians(10.0)))  # normals of one direction
DISTINCT = float(np.cos(np.radians(20.0)))  # between candidates; of nearer ones the best fitting one counts
WINDOWS = np.radians([12.0, 8.0, 6.0, 6.0])  # of the robust fit, from coarse to fine
SAMPLE = 150  # surfels that propose a direction
# How plausible an angle between the expected and the true vertical is: most sensors stand within some degrees of it,
# some are tilted, some lie on their side, few hang. (weight, middle, standard deviation), radians. Those that lie on
# their side weigh more than they are frequent: a wrong answer is worse than none.
MOUNTS = ((0.6, 0.0, 0.26), (0.2, 0.0, 0.7), (0.1, np.pi / 2, 0.26), (0.01, np.pi, 0.26))
STATED = ((0.95, 0.0, 0.26), (0.05, 0.0, 0.7))  # the same for a stated mount: a hand sways
LEAST_AXIS_ODDS = 1.5  # natural logarithm; below, the axis is not sure
NEAR = float(np.cos(np.radians(45.0)))  # of the expected vertical, as it is mounted on most carriers
SIGN_SURE = 1.0  # likewise
LEAST_FITTING = 0.3  # share of surfaces parallel or square to the vertical; under a bare roof there may be fewer
NORMAL_SIGMA = np.radians(4.0)  # of a surfel's normal, with what surfels of one wall have in common
ALIKE = 3.0  # surfels of one surface share errors: so many count as one measurement of its direction


@dataclass(frozen=True)
class Gravity:
    """The vertical in the frame of the surfels: `up_in_odom` (3,), a unit vector, and `sigma` (rad) of its direction.

    Natural log odds: `axis_odds` against the next best vertical, expectation and all; `sign_odds` against upside down,
    by the expectation alone: of that, the surfaces of a few seconds show little.
    """

    up_in_odom: Floats
    sigma: float
    axis_odds: float
    sign_odds: float

    @property
    def axis_sure(self) -> bool:
        """Whether no other axis is as likely; else it is the likeliest one near the expected vertical."""
        return self.axis_odds >= LEAST_AXIS_ODDS

    @property
    def sign_sure(self) -> bool:
        """Whether the expected mount tells which end is up."""
        return self.sign_odds >= SIGN_SURE


@dataclass(frozen=True)
class _Candidate:
    axis: Floats
    odds: float  # that it is the vertical, without the expected mount


def estimate_gravity(
    positions: Floats, normals: Floats, weights: Floats, sensor_positions: Floats, expected_up: Floats,
    is_stated: bool = False,
) -> Gravity | None:  # fmt: skip
    """The vertical, or None if it cannot be told; where two axes are as likely, that near the expected one.

    Args: surfels of the first seconds in a frame of any attitude: positions (N, 3) in metres, unit normals (N, 3)
    turned to the sensor that saw them, weights (N,) such as areas or numbers of points; the sensor's positions (M, 3)
    on its way; `expected_up` (3,), the vertical if the sensor is mounted as expected: a hint, and a strong one where
    that `is_stated`.
    """
    if len(positions) < FEWEST:
        return None
    capped = np.minimum(weights, np.median(weights))  # near surfaces have many points, not more to say
    capped = capped / capped.max()
    expected = expected_up / np.linalg.norm(expected_up)
    views = [UprightView.along(axis, positions, normals, capped, sensor_positions) for axis in _axes(normals, capped)]
    if not views:
        return None
    mounts = STATED if is_stated else MOUNTS
    candidates = [_Candidate(view.up, axis_log_odds(view)) for view in views]
    up, axis_odds, sign_odds = _choose(candidates, expected, mounts)
    if axis_odds < LEAST_AXIS_ODDS and up @ expected < NEAR:
        candidates = [candidate for candidate in candidates if abs(candidate.axis @ expected) > NEAR]
        if not candidates:
            return None
        up, _, sign_odds = _choose(candidates, expected, mounts)
    if _fitting(up, normals, capped) < LEAST_FITTING:
        return None
    return Gravity(up, _sigma(up, normals, capped), axis_odds, sign_odds)


def refined_up(up: Floats, normals: Floats, counts: Floats) -> tuple[Floats, float] | None:
    """The vertical (3,) near `up` (3,) that surfels with unit normals (N, 3) and numbers of points (N,) show, and its
    standard deviation (rad); None where they are few, or too few of them are upright or level."""
    if len(normals) < FEWEST:
        return None
    weights = np.minimum(counts, np.median(counts))
    weights = weights / weights.max()
    _, found = _refined(up, normals, weights)
    if _fitting(found, normals, weights) < LEAST_FITTING:
        return None
    return found, _sigma(found, normals, weights)


def _axes(normals: Floats, weights: Floats) -> list[Floats]:
    """Candidates (3,), either end up: the commonest directions of surfaces and those square to two of them, refined."""
    left, directions = weights.copy(), list[Floats]()
    proposals = normals[:: max(1, len(normals) // SAMPLE)]
    alike = (np.abs(proposals @ normals.T) > SPREAD).astype(np.float64)
    while len(directions) < DIRECTIONS and left.sum() > LEAST_SHARE * weights.sum():
        direction = _mean_direction(proposals[np.argmax(alike @ left)], normals, left)
        directions.append(direction)
        left[np.abs(normals @ direction) > SPREAD] = 0.0
    square = [np.cross(a, b) for k, a in enumerate(directions) for b in directions[:k] if abs(a @ b) < 0.9]
    refined = [_refined(start / np.linalg.norm(start), normals, weights) for start in directions + square]
    axes: list[Floats] = []
    for _, axis in sorted(refined, key=lambda found: -found[0]):
        if all(abs(axis @ other) < DISTINCT for other in axes):
            axes.append(axis)
    return axes


def _mean_direction(start: Floats, normals: Floats, weights: Floats) -> Floats:
    direction = start
    for _ in range(2):
        cosine = normals @ direction
        turned = np.where(np.abs(cosine) > SPREAD, np.sign(cosine) * weights, 0.0)
        direction = turned @ normals / np.linalg.norm(turned @ normals)
    return direction


def _refined(axis: Floats, normals: Floats, weights: Floats) -> tuple[float, Floats]:
    """The axis to which the surfels near it and near its plane are most parallel and square (Tukey's biweight), after
    the weight of those surfels."""
    fitting = 0.0
    for window in WINDOWS:
        square_sine = np.sin(window) ** 2
        cosine = normals @ axis
        level = weights * np.clip(1 - (1 - cosine**2) / square_sine, 0.0, None) ** 2
        upright = weights * np.clip(1 - cosine**2 / square_sine, 0.0, None) ** 2
        fitting = float(level.sum() + upright.sum())
        vector = np.linalg.eigh((normals * (upright - level)[:, None]).T @ normals)[1][:, 0]
        axis = vector * (1.0 if vector @ axis > 0 else -1.0)
    return fitting, axis


def _expectation(up: Floats, expected_up: Floats, mounts: Mounts) -> float:
    """The log density of a mount whose vertical lies so far from the expected one."""
    angle = np.arccos(np.clip(up @ expected_up, -1.0, 1.0))
    densities = [w / sigma**2 * np.exp(-(((angle - middle) / sigma) ** 2) / 2) for w, middle, sigma in mounts]
    return float(np.log(sum(densities)))


def _choose(candidates: list[_Candidate], expected_up: Floats, mounts: Mounts) -> tuple[Floats, float, float]:
    """The likeliest vertical, its log odds against all other axes and against upside down."""
    ends = [(c.axis * end, c) for c in candidates for end in (1.0, -1.0)]
    odds = np.array([c.odds + _expectation(up, expected_up, mounts) for up, c in ends])
    best = int(np.argmax(odds))
    up, chosen = ends[best]
    others = [o for o, (_, c) in zip(odds, ends, strict=True) if c is not chosen]
    flipped = odds[best ^ 1]
    axis_odds = np.logaddexp(odds[best], flipped) - np.logaddexp.reduce(others) if others else np.inf
    return up, float(axis_odds), float(odds[best] - flipped)


def _fitting(up: Floats, normals: Floats, weights: Floats) -> float:
    cosine = np.abs(normals @ up)
    return float(weights[(cosine > SPREAD) | (cosine < np.sqrt(1 - SPREAD**2))].sum() / weights.sum())


def _sigma(up: Floats, normals: Floats, weights: Floats) -> float:
    """The standard deviation of the direction in its weakest sense, from the normals that fit it."""
    cosine = normals @ up
    x = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    x /= np.linalg.norm(x)
    across = normals @ np.stack([x, np.cross(up, x)]).T
    level, upright = weights * (np.abs(cosine) > SPREAD), weights * (np.abs(cosine) < np.sqrt(1 - SPREAD**2))
    # a level surface tells both angles, an upright one that about the line in which it cuts the level
    information = np.eye(2) * level.sum() + (across * upright[:, None]).T @ across
    return float(NORMAL_SIGMA * np.sqrt(ALIKE / max(np.linalg.eigvalsh(information)[0], 1e-9)))
