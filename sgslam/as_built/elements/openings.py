"""The verdict on an opening, by one likelihood over where rays cross the wall around it and what they meet there.

Open or closed, an opening has jambs: outside of them rays end at the wall's face, inside they go on, or end at a leaf,
a pane or the reveal. Where the wall goes on instead, they all end at its face.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.crossed_walls import CrossedWall, Crossings, Reveal, crossed_walls, reveal_of
from sgslam.as_built.elements.likelihoods import (
    DEPTH,
    LEAST_CELLS,
    LEAST_VIEWS,
    SPREAD,
    SURE,
    THROUGH,
    Finding,
    Limits,
    bell,
    densest,
    judged,
    pose_noise,
    too_little,
)
from sgslam.as_built.elements.rays import CELL, SeenRays
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
STEP = SENSOR.range_noise / 4  # m, between the places of a jamb that are tried
NARROWER = 0.1  # m, widest frame that narrows an opening at a jamb
_SIDE = round((BUILDING.displaced + NARROWER) / STEP)
PLACES = np.arange(-_SIDE, _SIDE + 1) * STEP
_AT_PLAN = 0.7  # of what is met of a jamb, leaf or pane: itself, not a frame or a handle before it
_FLUSH = 0.05  # of the rays into an opening that meet something at the wall's face
_SET_BACK = 0.03  # m behind the wall's face, from which on a leaf or pane is distinct from a wall that goes on


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
    steps, widest, middle = round(BUILDING.displaced / STEP), round(NARROWER / STEP), len(PLACES) // 2
    s = np.arange(-steps, steps + 1)
    frames = range(0, widest + 1, widest // 5)
    terms = [
        left[middle + s + a] + right[middle - s + b] + np.log(_prior(a, b, len(frames))) for a in frames for b in frames
    ]
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


@dataclass(frozen=True)
class _Fit:
    """Log-likelihoods that the wall goes on, and that the opening is there, at its best displacement `along` the wall
    with its standard deviation `sigma` (m). `left` is by how much the jamb that went into the planned wall is likelier
    there than at its place."""

    filled: float
    there: float
    along: float
    sigma: float
    left: float


def opening_finding(
    opening: PlannedElement, solids: list[PlannedElement], host: int, built: Finding, seen: SeenRays, limits: Limits
) -> Finding:
    """What the rays say of an opening in the solid with the index `host`, which was `built` so."""
    reveal, views, rays = reveal_of(opening, solids[host]), list(seen.views), seen.near(opening.triangles, host)
    if reveal is None:
        return Finding("not seen", "the plan has no upright wall around it")
    sides = crossed_walls(reveal, host, _shift(built, reveal), rays, views)
    if not sides:
        return Finding("not seen", "no ray reaches it")
    within = [side.within for side in sides]
    seen_by = np.unique(np.concatenate([side.view[own] for side, own in zip(sides, within, strict=True)]))
    cells = sum(len(np.unique(side.cell[own], axis=0)) for side, own in zip(sides, within, strict=True))
    count, share = len(seen_by), _share(sides, reveal)
    if count < LEAST_VIEWS or cells < LEAST_CELLS:
        return Finding("not seen", too_little(cells, count), seen=share, views=count)
    if built.verdict == "absent":
        return Finding("absent", "its wall is absent", seen=share, views=count)
    fit = _fit(sides, reveal)
    if fit.filled - fit.there > SURE:
        return Finding("absent", "its wall continues in its place", seen=share, views=count)
    if fit.there - fit.filled < SURE:
        why = "closed at the wall's face, by a leaf, a pane or the wall"
        return Finding("uncertain", why, seen=share, views=count)
    if _wall_is_absent(sides, fit.along):
        return Finding("uncertain", "rays pass beside it too: its edges are not seen", seen=share, views=count)
    state = "rays pass" if _open(sides) else "it is closed by a leaf or a pane"
    if fit.sigma > SENSOR.edge:
        return Finding("as planned", f"{state}; its edges are not seen", seen=share, views=count)
    poses = pose_noise([views[int(k)] for k in seen_by], reveal.along)
    sigma = float(np.linalg.norm([fit.sigma, limits.shared, poses.position]))
    doubt = fit.left < SURE  # a leaf, a frame or a curtain narrows an opening, but does not widen it
    verdict, kept = judged(fit.along, sigma, doubt, limits.tolerance)
    reason = f"its edges are at {1000 * fit.along:+.0f} mm along the wall; {state}"
    if doubt and abs(fit.along) > limits.tolerance:
        reason = f"{reason}; only one edge, which may be that of a leaf"
    direction = (float(reveal.along[0]), float(reveal.along[1]), 0.0)
    return Finding(verdict, reason, fit.along, direction, sigma, None, kept, share, count, doubt)


def _shift(built: Finding, reveal: Reveal) -> float | None:
    """Metres across, by which the wall was found off its place; None where it was not measured."""
    if built.offset is None or built.direction is None:
        return None
    return built.offset * float(np.dot(built.direction, reveal.across))


def _fit(sides: list[CrossedWall], reveal: Reveal) -> _Fit:
    filled = sum(unbroken(side.crossings(jamb)) for side in sides for jamb in (0, 1))
    profiles = [_profiles(sides, reveal, flush) for flush in _flush_sides(sides, reveal)]
    fits = [displacements(*own) for own in profiles]
    s = fits[0][0]
    likeliest = profiles[int(np.argmax([found.max() for _, found in fits]))]
    total = np.logaddexp.reduce([found for _, found in fits], axis=0)
    best = int(np.argmax(total))
    density = np.exp(total - total[best])
    sigma = float(np.sqrt(np.sum(density * (s - s[best]) ** 2) / density.sum()))
    return _Fit(filled, float(total[best]), float(s[best]), sigma, widened(likeliest, float(s[best])))


def _flush_sides(sides: list[CrossedWall], reveal: Reveal) -> Iterator[int | None]:
    """On which of the sides a leaf or pane may lie in the wall's face: on one at most, and not where it is planned
    behind it."""
    yield None
    for k, side in enumerate(sides):
        planned = reveal.set_back[side.face]
        if planned is None or planned < _SET_BACK:
            yield k


def _profiles(sides: list[CrossedWall], reveal: Reveal, flush: int | None) -> tuple[Floats, Floats]:
    """Those of both jambs, by all sides."""
    found = np.zeros((2, len(PLACES)))
    for k, side in enumerate(sides):
        for jamb in (0, 1):
            rays = side.crossings(jamb)  # a leaf or pane in the face is met as the wall is
            found[jamb] += unbroken(rays) if k == flush else jamb_profile(rays, _inside(side, reveal))
    return found[0], found[1]


def _inside(side: CrossedWall, reveal: Reveal) -> Inside:
    """What rays from a side met that passed its face in the planned opening."""
    depth = side.depth[side.within & (side.depth > _SET_BACK)]
    beyond = depth > reveal.depth + 2 * SENSOR.range_noise
    through = float(np.clip((1 + beyond.sum()) / (2 + len(depth)), 0.05, 0.95))
    return Inside(reveal.depth, through, _densest(depth[~beyond]))


def _densest(depth: Floats) -> float | None:
    """The depth about which most others lie."""
    if not len(depth):
        return None
    tries = np.arange(depth.min(), depth.max() + SENSOR.range_noise, SENSOR.range_noise / 2)
    return densest(depth, tries)


def _open(sides: list[CrossedWall]) -> bool:
    through = [side.through[side.within] for side in sides]
    return float(np.concatenate(through).mean()) > 0.5


def _wall_is_absent(sides: list[CrossedWall], along: float) -> bool:
    """Whether most rays beside the opening, displaced so, pass the wall."""
    beside = [(side.through[own], side.weight[own]) for side in sides for own in [side.beside(along)]]
    through, weight = (np.concatenate(part) for part in zip(*beside, strict=True))
    return bool(len(weight)) and float(through @ weight) > 0.5 * float(weight.sum())


def _share(sides: list[CrossedWall], reveal: Reveal) -> float:
    """Of the cells of the opening and its jambs, how many rays tell of."""
    cells = np.concatenate([side.cell for side in sides])
    across, up = (np.ceil(length / CELL) for length in (reveal.width + 2 * CELL, reveal.top - reveal.bottom))
    return min(1.0, len(np.unique(cells, axis=0)) / (float(across) * float(up)))
