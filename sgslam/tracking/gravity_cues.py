"""Surfels seen along an axis, and what speaks for that axis being the vertical of a building.

Each cue is a log odds (natural logarithm); the weights are near those of a logistic regression over simulated walks
through a dozen buildings.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEVEL = float(np.cos(np.radians(10.0)))  # of a normal's z: a voxel of a floor is level to a few degrees
UPRIGHT = float(np.sin(np.radians(10.0)))
HIGHEST_STOREY = 4.0  # m: what is seen within one storey rarely spans more
FARTHEST = 2.5  # m between a carried sensor and the floor or the ceiling
BOB = 0.03  # m: a walking person's up and down
MEASURED = 0.02  # share of surfaces across the axis, below which the way along it is hardly measured
FACES = 0.4  # m: so near the lowest and highest points, a level surface is floor or ceiling


@dataclass(frozen=True)
class UprightView:
    """Surfels in a frame whose z axis is up, if the axis is the vertical, and whose x axis is square to most walls.

    The origin is the mean of the sensor's positions. Metres; positions, normals and sensors (N, 3), weights (N,); `up`
    (3,) is the z axis in the surfels' own frame.
    """

    up: Floats
    positions: Floats
    normals: Floats
    weights: Floats
    sensors: Floats

    @staticmethod
    def along(up: Floats, positions: Floats, normals: Floats, weights: Floats, sensors: Floats) -> "UprightView":
        """The view with this unit vector (3,) as z axis."""
        x = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(up, x), up])
        n = normals @ R.T
        # four times the angle is the same for all sides of a rectangular room
        walls = np.where(np.abs(n[:, 2]) < UPRIGHT, weights, 0.0)
        turn = np.angle(np.sum(walls * np.exp(4j * np.arctan2(n[:, 1], n[:, 0])))) / 4
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R
        middle = sensors.mean(axis=0)
        return UprightView(up, (positions - middle) @ R.T, normals @ R.T, weights, (sensors - middle) @ R.T)


def axis_log_odds(view: UprightView) -> float:
    """What speaks for the view's z axis as the vertical, whichever end is up. Only differences have a meaning."""
    z, n = view.positions[:, 2], np.abs(view.normals[:, 2])
    total = view.weights.sum()
    low, high = quantiles(z, view.weights)
    # Walls lie at any distance, floors and ceilings within a storey,
    too_high = float(np.clip((high - low - HIGHEST_STOREY) / 2, 0.0, 3.0))
    # and within reach of a sensor that is carried.
    too_far = float(np.clip(max(-low, high) - FARTHEST, 0.0, 4.0))
    # In a building every surface is level or upright; about another axis skewed walls and partitions are neither.
    fitting = float(view.weights[(n > LEVEL) | (n < UPRIGHT)].sum() / total)
    # Nothing large and level lies between floor and ceiling; between two walls of a building there are others.
    between = float(view.weights[(n > LEVEL) & (z > low + FACES) & (z < high - FACES)].sum() / total)
    # One walks in the level. On a stair this is wrong, so it weighs less than its fit, 3.3.
    climbing = float(np.clip(np.log(max(float(view.sensors[:, 2].std()), BOB) / BOB), 0.0, 3.0))
    # Where nothing across the axis is seen, an unknown drift along it is no climb.
    climbing *= min(float(view.weights[n > LEVEL].sum() / total) / MEASURED, 1.0)
    return -1.5 * too_high - 1.0 * too_far + 4.0 * fitting - 1.0 * between - 2.0 * climbing


def quantiles(z: Floats, weights: Floats) -> tuple[float, float]:
    """Below and above which a hundredth of the weight lies."""
    order = np.argsort(z)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(z[order][np.searchsorted(share, 0.01)]), float(z[order][np.searchsorted(share, 0.99)])
