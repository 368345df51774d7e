"""Where a column stands: its shift in plan view, by the rays that meet its body or pass its place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.likelihoods import (
    BEFORE,
    DEPTH,
    LEAST_CELLS,
    LEAST_VIEWS,
    SPREAD,
    SURE,
    THROUGH,
    Finding,
    Limits,
    bell,
    judged,
    pose_noise,
)
from sgslam.as_built.elements.rays import Rays, SeenRays, View
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_AROUND = 0.1  # m beyond the furthest shifted body
_MOST = 2000  # rays of a column; more make it no more certain than the poses are
_AT_OTHERS = 0.6  # of the rays that miss the body: those that end at what else is planned
# m: half the side and step of grids of shifts, one in another
_GRIDS = ((BUILDING.displaced, 0.05), (0.05, 0.01), (0.012, 0.003))
# m, noise with which the coarse grid is searched, so that no shift falls between its places
_BLURRED = 2 * SENSOR.range_noise
_LEAST_HITS = 10  # rays that end at the body, or pass its place
_EXPLAINED = 0.5  # of the rays towards a moved column's planned place: those that pass or meet the column itself
_WIDER = 0.3  # of what is met there: what the body does not explain


@dataclass(frozen=True)
class Passing:
    """N rays that cross the disc in plan view in which the column is looked for; `enters`, `leaves` (N,) are the ranges
    (m) at its edge, `others` (N,) that of what else is planned."""

    rays: Rays
    enters: Floats
    leaves: Floats
    others: Floats

    @property
    def shown(self) -> Flags:
        """Which reach the disc."""
        return self.rays.measured > self.enters

    @property
    def within(self) -> Flags:
        """Which end in the disc, and not at what else is planned."""
        ends = (self.rays.measured > self.enters) & (self.rays.measured < self.leaves)
        return ends & (np.abs(self.rays.measured - self.others) > 3 * SENSOR.range_noise)

    def ranges(self, body: TriangleScene, shift: Floats) -> Floats:
        """(N,) at which the rays meet the body, shifted by (3,); inf where they miss it."""
        return body.distances(self.rays.origin - shift, self.rays.direction)

    def absent(self) -> float:
        """The log-likelihood of the rays if nothing stands there."""
        return float(np.sum(np.log(self._missing())))

    def standing(self, body: TriangleScene, shifts: Floats, noise: float) -> Floats:
        """(S,) log-likelihoods if the body stands at each of the shifts (S, 3), with a `noise` (m) of the ranges."""
        missing = self._missing()
        found = []
        for shift in shifts:
            met = self.ranges(body, shift)
            hits = met < self.others
            off = self.rays.measured - np.where(hits, met, np.inf)
            else_ = np.where(off < 0, BEFORE, THROUGH) / DEPTH
            density = np.where(hits, (1 - BEFORE - THROUGH) * bell(off, noise) + else_, missing)
            found.append(float(np.sum(np.log(density))))
        return np.array(found)

    def _missing(self) -> Floats:
        """Densities (1/m) of what rays meet that miss the body: something else that is planned, or is not."""
        beyond = self.rays.measured > self.leaves
        unplanned = np.where(beyond, 1 - BEFORE - SPREAD, BEFORE + SPREAD) / DEPTH
        off = self.rays.measured - self.others
        planned = np.isfinite(self.others)
        at = bell(np.where(planned, off, 0.0)) * planned
        return np.asarray(np.where(planned, _AT_OTHERS * at + (1 - _AT_OTHERS) * unplanned, unplanned))


def passing(index: int, solids: list[PlannedElement], rays: Rays) -> Passing:
    """The rays close to the solid with this index that end in its disc or behind it."""
    corners = solids[index].triangles.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    radius = float(np.linalg.norm((high - low)[:2])) / 2 + BUILDING.displaced + _AROUND
    rays = rays[np.linalg.norm((rays.origin - middle)[:, :2], axis=1) < SENSOR.furthest]
    level = np.linalg.norm(rays.direction[:, :2], axis=1)
    to_middle = np.sum((middle - rays.origin)[:, :2] * rays.direction[:, :2], axis=1) / np.maximum(level, 1e-6)
    aside = np.linalg.norm((middle - rays.origin)[:, :2], axis=1) ** 2 - to_middle**2
    half = np.sqrt(np.maximum(radius**2 - aside, 0.0))
    enters, leaves = (np.maximum(x, 0.0) / np.maximum(level, 1e-6) for x in (to_middle - half, to_middle + half))
    z = rays.at((enters + leaves) / 2)[:, 2]
    near = (half > 0) & (leaves > 0) & (z > low[2]) & (z < high[2]) & (rays.measured > enters)
    chosen = np.flatnonzero(near)
    chosen = chosen[:: max(1, len(chosen) // _MOST)]
    rays, enters, leaves = rays[chosen], enters[chosen], leaves[chosen]
    rest = [element.triangles for k, element in enumerate(solids) if k != index]
    others = np.full(len(chosen), np.inf)
    if rest and len(chosen):
        others = TriangleScene(np.concatenate(rest)).distances(rays.origin, rays.direction)
    return Passing(rays, enters, leaves, others)


def is_column(element: PlannedElement) -> bool:
    """Whether an element is compact and upright, so that it can be shifted in plan view."""
    return element.ifc_class.startswith("IfcColumn")


def column_finding(index: int, solids: list[PlannedElement], seen: SeenRays, limits: Limits) -> Finding:
    """What the rays say of the solid with this index."""
    views, rays = seen.views, seen.near(solids[index].triangles, index)
    body = TriangleScene(solids[index].triangles)
    near = passing(index, solids, rays)
    at_plan = near.ranges(body, np.zeros(3))
    aimed = near.shown & (at_plan < near.others)
    if aimed.sum() < _LEAST_HITS:
        return Finding("not seen", "hidden by what is planned around it, or not in view")
    told_by = aimed & (near.rays.measured > at_plan - 3 * SENSOR.range_noise)
    shift, stands, spread = _fit(near, body)
    met = near.ranges(body, shift)
    visible = near.shown & (met < near.others)
    at = visible & (np.abs(near.rays.measured - met) < 3 * SENSOR.range_noise)
    through = told_by & (near.rays.measured > near.leaves)
    seen_by = np.unique(near.rays.view[at | through])
    count, share = len(seen_by), float((at | told_by).sum() / max((visible | aimed).sum(), 1))
    if count < LEAST_VIEWS or at.sum() + through.sum() < _LEAST_HITS:
        reason = f"{int(at.sum() + through.sum())} rays from {count} keyframes"
        return Finding("not seen", reason, seen=share, views=count)
    absent = near.absent()
    if absent - stands > SURE and through.sum() >= LEAST_CELLS:
        return Finding("absent", "seen through its place", seen=share, views=count)
    if stands - absent < SURE or at.sum() < _LEAST_HITS:
        return Finding("uncertain" if through.any() else "not seen", "mostly hidden", seen=share, views=count)
    corners = solids[index].triangles.reshape(-1, 3)[:, :2]
    outline = np.array([corners.min(axis=0), corners.max(axis=0)])
    doubt = ""
    if _may_be_before(near, outline + shift[:2], at):
        doubt = "wider than planned and seen from one side only: it may be furniture"
    elif np.sum(aimed & (at | told_by)) < _EXPLAINED * aimed.sum():
        doubt = "but something else hides its place"
    found = _standing(near, shift, spread, at, views, limits, share, doubt)
    hidden = found.verdict == "uncertain" and told_by.sum() < _LEAST_HITS
    return Finding("not seen", "something in front of it hides it", seen=share, views=count) if hidden else found


def _standing(
    near: Passing,
    shift: Floats,
    spread: Floats,
    at: NDArray[np.bool_],
    views: Sequence[View],
    limits: Limits,
    share: float,
    doubt: str,
) -> Finding:
    """The finding on a column that stands at this shift, with its covariance `spread` (2, 2); `doubt` is why it may be
    something else that does."""
    seen_by = np.unique(near.rays.view[at])
    distance = float(np.linalg.norm(shift))
    direction = shift / distance if distance > 0 else np.array([1.0, 0.0, 0.0])
    own = float(np.sqrt(direction[:2] @ spread @ direction[:2]))
    poses = pose_noise([views[int(k)] for k in seen_by], direction)
    sigma = float(np.linalg.norm([own, limits.shared, poses.position]))
    distance = float(np.sqrt(max(distance**2 - sigma**2, 0.0)))  # noise makes a vector longer, never shorter
    verdict, kept = judged(distance, sigma, bool(doubt), limits.tolerance)
    reason = f"it stands {1000 * distance:.0f} mm off in plan view, by {int(at.sum())} rays"
    if doubt and verdict == "uncertain":
        reason = f"{reason}; {doubt}"
    n = (float(direction[0]), float(direction[1]), 0.0)
    return Finding(verdict, reason, distance, n, sigma, None, kept, share, len(seen_by), bool(doubt))


def _may_be_before(near: Passing, outline: Floats, at: NDArray[np.bool_]) -> bool:
    """Whether what was met is wider than the column, and was seen from one side alone. `outline` (2, 2) are the lowest
    and the highest x, y of the shifted body."""
    places = near.rays.at(near.rays.measured)[:, :2]
    close = np.all((places > outline[0] - SENSOR.apart) & (places < outline[1] + SENSOR.apart), axis=1)
    clutter = np.sum(near.within & close & ~at)
    from_sensor = near.rays.direction[at]
    wider = clutter > _WIDER * (clutter + at.sum())
    return bool(wider and np.all(from_sensor @ from_sensor.mean(axis=0) > 0))


def _fit(near: Passing, body: TriangleScene) -> tuple[Floats, float, Floats]:
    """As `_best`, from grid to grid; the coarser one of two tells the covariance where it does not fit in the finer."""
    (furthest, *finer) = _GRIDS
    shift, stands, spread = _best(near, body, _grid(*furthest), _BLURRED)
    spread = np.zeros((2, 2))
    for own in finer:
        shift, stands, found = _best(near, body, shift + _grid(*own), SENSOR.range_noise)
        spread = max(spread, found, key=np.trace)
    return shift, stands, spread


def _grid(reach: float, step: float) -> Floats:
    """(S, 3) shifts in plan view, in a disc."""
    line = np.arange(-round(reach / step), round(reach / step) + 1) * step
    x, y = (part.ravel() for part in np.meshgrid(line, line, indexing="ij"))
    within = np.hypot(x, y) <= reach + step / 2
    return np.column_stack([x, y, np.zeros(x.size)])[within]


def _best(near: Passing, body: TriangleScene, shifts: Floats, noise: float) -> tuple[Floats, float, Floats]:
    """The likeliest shift (3,), its log-likelihood, and the covariance (2, 2) of the shifts about it."""
    found = near.standing(body, shifts, noise)
    best = int(np.argmax(found))
    density = np.exp(found - found[best])
    off = shifts[:, :2] - shifts[best, :2]
    return shifts[best], float(found[best]), (density[:, None] * off).T @ off / density.sum()
