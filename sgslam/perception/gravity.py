"""The vertical from the surfaces of a building: walls are upright, floors and ceilings level.

Most surfaces are parallel or square to the vertical, but in most buildings also to two other directions. Which axis is
the vertical is decided by what speaks for each of them, summed as log odds (natural logarithm). Which end of it is up
the surfaces hardly show: it is the end nearer to the expected vertical.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config.sensor import BUILDING, CARRIER, SENSOR

Floats = NDArray[np.float64]

_FEWEST = 30  # surfels
ALIKE = np.radians(10.0)  # between normals of one direction; a cell of a floor is level to a few degrees
_ALIGNED, _SQUARE = float(np.cos(ALIKE)), float(np.sin(ALIKE))
_DIRECTIONS = 6  # of surfaces that are looked at, the commonest first
_SAMPLE = 150  # surfels that propose a direction
_WINDOWS = np.radians([12.0, 8.0, 6.0, 6.0])  # of the robust fit, from coarse to fine
_LEAST_FITTING = 0.3  # share of surfaces parallel or square to the vertical; under a bare roof there may be fewer
# Concentration of the vertical about the expected one (Watson distribution of axes): most sensors stand within some
# degrees of it, and some lie on their side. Of a stated mount only a hand's sway remains.
_USUAL, _STATED = 1.8, 7.4
_LEAST_ODDS = 1.5  # below, the axis is not sure
_PER_SURFACE = 3.0  # surfels of one surface share errors: so many count as one measurement of its direction
_FACES = 0.4  # m: so near the lowest and highest points, a level surface is floor or ceiling


@dataclass(frozen=True)
class Gravity:
    """The vertical `up` (3,), a unit vector in the frame of the surfels; `is_sure`: no other axis is as likely."""

    up: Floats
    is_sure: bool


def find_gravity(
    surfels: tuple[Floats, Floats, Floats], sensor_positions: Floats, expected_up: Floats, is_stated: bool
) -> Gravity | None:
    """The vertical, or None if it is unknown; where two axes are as likely, that near the expected one.

    Args: `surfels` of the first seconds in a frame of any attitude: positions (N, 3) in metres, unit normals (N, 3),
    numbers of points (N,); the sensor's positions (M, 3) on its way; `expected_up` (3,), a unit vector, the vertical if
    the sensor is mounted as expected: a hint, and a strong one where that `is_stated`.
    """
    positions, normals, counts = surfels
    if len(positions) < _FEWEST:
        return None
    weights = _capped(counts)
    axes = [axis if axis @ expected_up > 0 else -axis for axis in _axes(normals, weights)]
    towards = np.array([axis @ expected_up for axis in axes])
    odds = np.array([_axis_odds(axis, positions, normals, weights, sensor_positions) for axis in axes])
    odds += (_STATED if is_stated else _USUAL) * towards**2
    best = int(np.argmax(odds))
    is_sure = bool(odds[best] - np.logaddexp.reduce(np.delete(odds, best)) >= _LEAST_ODDS)
    if not is_sure and towards[best] < np.cos(CARRIER.lying):
        best = int(np.argmax(np.where(towards > np.cos(CARRIER.lying), odds, -np.inf)))
        if towards[best] <= np.cos(CARRIER.lying):
            return None
    return Gravity(axes[best], is_sure) if _fitting(axes[best], normals, weights) >= _LEAST_FITTING else None


def refined_up(up: Floats, normals: Floats, counts: Floats) -> tuple[Floats, float] | None:
    """The vertical (3,) near `up` (3,) that surfels with unit normals (N, 3) and numbers of points (N,) show, and its
    standard deviation (rad); None where they are few, or too few of them are upright or level."""
    if len(normals) < _FEWEST:
        return None
    weights = _capped(counts)
    _, found = _refined(up, normals, weights)
    if _fitting(found, normals, weights) < _LEAST_FITTING:
        return None
    return found, _sigma(found, normals, weights)


def _capped(counts: Floats) -> Floats:
    """Weights (N,) of at most 1: near surfaces have many points, not more to say."""
    weights = np.minimum(counts, np.median(counts))
    return np.asarray(weights / weights.max())


def _axes(normals: Floats, weights: Floats) -> list[Floats]:
    """Candidates (3,), either end up: the commonest directions of surfaces and those square to two of them, refined."""
    left, directions = weights.copy(), list[Floats]()
    proposals = normals[:: max(1, len(normals) // _SAMPLE)]
    alike = (np.abs(proposals @ normals.T) > _ALIGNED).astype(np.float64)
    while len(directions) < _DIRECTIONS and left.any():
        commonest = int(np.argmax(alike @ left))
        directions.append(proposals[commonest])
        left[np.abs(normals @ proposals[commonest]) > _ALIGNED] = 0.0
    square = [np.cross(a, b) for k, a in enumerate(directions) for b in directions[:k] if abs(a @ b) < 0.9]
    refined = [_refined(start / np.linalg.norm(start), normals, weights) for start in directions + square]
    axes: list[Floats] = []
    for _, axis in sorted(refined, key=lambda found: -found[0]):
        if all(abs(axis @ other) < np.cos(2 * ALIKE) for other in axes):
            axes.append(axis)
    return axes


def _refined(axis: Floats, normals: Floats, weights: Floats) -> tuple[float, Floats]:
    """The axis to which the surfels near it and near its plane are most parallel and square (Tukey's biweight), after
    the weight of those surfels."""
    fitting = 0.0
    for window in _WINDOWS:
        square_sine = np.sin(window) ** 2
        cosine = normals @ axis
        level = weights * np.clip(1 - (1 - cosine**2) / square_sine, 0.0, None) ** 2
        upright = weights * np.clip(1 - cosine**2 / square_sine, 0.0, None) ** 2
        fitting = float(level.sum() + upright.sum())
        vector = np.linalg.eigh((normals * (upright - level)[:, None]).T @ normals)[1][:, 0]
        axis = vector * (1.0 if vector @ axis > 0 else -1.0)
    return fitting, axis


def _axis_odds(axis: Floats, positions: Floats, normals: Floats, weights: Floats, sensors: Floats) -> float:
    """What speaks for an axis (3,) as the vertical, whichever end is up. Only differences have a meaning.

    The factors are near those of a logistic regression over simulated walks through a dozen buildings.
    """
    z, way = positions @ axis, sensors @ axis
    level = np.abs(normals @ axis) > _ALIGNED
    low, high = _extent(z, weights)
    # Walls lie at any distance, floors and ceilings within a storey.
    too_high = min(max(high - low - BUILDING.storey, 0.0), 6.0)
    # Nothing large and level lies between floor and ceiling; between two walls of a building there are others.
    is_between = level & (z > low + _FACES) & (z < high - _FACES)
    between = float(weights[is_between].sum() / weights.sum())
    # One walks in the level. On a stair this is wrong, so it weighs less than its fit, 3.3.
    climbing = min(float(np.log(max(float(way.std()), CARRIER.bob) / CARRIER.bob)), 3.0)
    # In a building every surface is level or upright; about another axis skewed walls and partitions are neither.
    fitting = _fitting(axis, normals, weights)
    return 4.0 * fitting - 1.25 * too_high - between - 2.0 * climbing


def _extent(z: Floats, weights: Floats) -> tuple[float, float]:
    """Below and above which a hundredth of the weight lies."""
    order = np.argsort(z)
    share = np.cumsum(weights[order]) / weights.sum()
    low, high = z[order][np.searchsorted(share, [0.01, 0.99])]
    return float(low), float(high)


def _fitting(up: Floats, normals: Floats, weights: Floats) -> float:
    """The share of the weight of surfels that are parallel or square to `up` (3,)."""
    cosine = np.abs(normals @ up)
    return float(weights[(cosine > _ALIGNED) | (cosine < _SQUARE)].sum() / weights.sum())


def _sigma(up: Floats, normals: Floats, weights: Floats) -> float:
    """The standard deviation (rad) of the direction in its weakest sense, from the normals that fit it."""
    cosine = np.abs(normals @ up)
    x = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    x /= np.linalg.norm(x)
    across = normals @ np.stack([x, np.cross(up, x)]).T
    level, upright = weights * (cosine > _ALIGNED), weights * (cosine < _SQUARE)
    # a level surface tells both angles, an upright one that about the line in which it cuts the level
    information = np.eye(2) * level.sum() + (across * upright[:, None]).T @ across
    return float(SENSOR.normal_noise * np.sqrt(_PER_SURFACE / max(np.linalg.eigvalsh(information)[0], 1e-9)))
