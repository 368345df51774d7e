"""The likelihood of the place of one jamb of an opening, from the rays that cross the wall's near face beside it.

Depths are metres behind the near face; the place of a jamb is metres from the planned one into the opening.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sgslam.as_built.elements.likelihoods import DEPTH, REACH, SPREAD, THROUGH, bell
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
STEP = 0.005  # m, between the places of a jamb that are tried
NARROWER = 0.1  # m, widest frame that narrows an opening at a jamb
FURTHEST = REACH + NARROWER  # m, of a jamb from its planned place
PLACES = np.arange(-round(FURTHEST / STEP), round(FURTHEST / STEP) + 1) * STEP
_AT_PLAN = 0.7  # of what is met of a jamb, leaf or pane: itself, not a frame or a handle before it
_FLUSH = 0.05  # of the rays into an opening that meet something at the wall's face


@dataclass(frozen=True)
class Crossings:
    """N rays from one side: place where they cross the near face, `near`, and leave the slab of the wall, `far`, metres
    from the planned jamb into the opening; `depth` of what they met; `blur`, the standard deviation of the crossing
    (m); and their `weight`."""

    near: Floats
    far: Floats
    depth: Floats
    blur: Floats
    weight: Floats


@dataclass(frozen=True)
class Inside:
    """What rays meet that pass the near face of a wall `thickness` metres thick: a share goes `through`; the others
    meet a leaf or pane at the depth `sheet`, None where none was seen, or something else in the reveal."""

    thickness: float
    through: float
    sheet: float | None

    def density(self, depth: Floats) -> Floats:
        """Of these depths (1/m)."""
        beyond = self.through * (depth > self.thickness) / DEPTH
        return _FLUSH * bell(depth) + (1 - _FLUSH) * (beyond + (1 - self.through) * self.in_reveal(depth))

    def in_reveal(self, depth: Floats) -> Floats:
        """Density of what is met between the faces."""
        anywhere = ((depth > 0) & (depth <= self.thickness)) / self.thickness
        if self.sheet is None:
            return np.asarray(anywhere)
        return _AT_PLAN * bell(depth - self.sheet) + (1 - _AT_PLAN) * anywhere


def jamb_profile(rays: Crossings, inside: Inside) -> Floats:
    """(K,) log-likelihoods of the jamb at each of PLACES."""
    near, far = (x[:, None] - PLACES for x in (rays.near, rays.far))
    blur = rays.blur[:, None]
    enters, leaves = ndtr(near / blur), ndtr(np.minimum(near, far) / blur)
    run = rays.near - rays.far
    outward = np.maximum(run, 1e-6)[:, None]
    at_jamb = inside.thickness * np.clip(near / outward, 0.0, 1.0)  # the depth at which a ray meets the jamb
    jamb = _AT_PLAN * bell(rays.depth[:, None] - at_jamb)
    jamb += ((1 - _AT_PLAN - SPREAD) * inside.in_reveal(rays.depth) + SPREAD / DEPTH)[:, None]
    clear = inside.density(rays.depth)[:, None]
    density = (1 - enters) * wall_density(rays.depth)[:, None] + (enters - leaves) * jamb + leaves * clear
    return np.asarray(rays.weight @ np.log(density + SPREAD * THROUGH / DEPTH))


def unbroken(rays: Crossings) -> float:
    """The log-likelihood that the wall goes on there."""
    return float(rays.weight @ np.log(wall_density(rays.depth) + SPREAD * THROUGH / DEPTH))


def wall_density(depth: Floats) -> Floats:
    """Of what is met where the wall stands (1/m)."""
    return np.asarray((1 - THROUGH - SPREAD) * bell(depth, SENSOR.range_noise) + (THROUGH + SPREAD) / DEPTH)


def displacements(left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Metres of displacement (S,) along the wall, and their log-likelihoods, from the profiles of both jambs.

    A frame may narrow the opening, at both jambs alike rather than at one. What is inside of `right` lies backwards.
    """
    steps, widest, middle = round(REACH / STEP), round(NARROWER / STEP), len(PLACES) // 2
    s = np.arange(-steps, steps + 1)
    frames = range(0, widest + 1, widest // 5)
    terms = []
    for a in frames:
        for b in frames:
            terms.append(left[middle + s + a] + right[middle - s + b] + np.log(_prior(a, b, len(frames))))
    return np.asarray(s * STEP), np.asarray(np.logaddexp.reduce(terms, axis=0))


def widened(profiles: tuple[Floats, Floats], along: float) -> float:
    """By how much the jamb that lies in the planned wall, if the opening is displaced `along` the wall, is likelier
    there than at its planned place, in log-likelihood."""
    profile = profiles[0] if along < 0 else profiles[1]
    middle, steps = len(PLACES) // 2, round(abs(along) / STEP)
    return float(profile[middle - steps] - profile[middle])


def _prior(a: int, b: int, count: int) -> float:
    """Half of all openings are as wide as planned; most others are narrowed alike at both jambs."""
    if a == b:
        return 0.5 if a == 0 else 0.3 / (count - 1)
    return 0.2 / (count * (count - 1))
