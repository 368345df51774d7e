"""The rays that pass close to a column, and how likely they are if its body stands at a shift from its plan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.likelihoods import BEFORE, DEPTH, REACH, SPREAD, THROUGH, bell
from sgslam.as_built.elements.rays import Rays
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_AROUND = 0.1  # m beyond the furthest shifted body
_MOST = 2000  # rays of a column; more make it no more certain than the poses are
_AT_OTHERS = 0.6  # of the rays that miss the body: those that end at what else is planned


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

    def ranges(self, body: TriangleScene, shifts: Floats) -> Floats:
        """(S, N) at which the rays meet the body at each of the shifts (S, 3); inf where they miss it."""
        count = len(self.rays.view)
        origins = (self.rays.origin[None] - shifts[:, None]).reshape(-1, 3)
        directions = np.broadcast_to(self.rays.direction, (len(shifts), count, 3)).reshape(-1, 3)
        return body.distances(origins, directions).reshape(len(shifts), count)

    def absent(self) -> float:
        """The log-likelihood of the rays if nothing stands there."""
        return float(np.sum(np.log(self._missing())))

    def standing(self, body: TriangleScene, shifts: Floats, noise: float) -> Floats:
        """(S,) log-likelihoods if the body stands at each of the shifts (S, 3), with a `noise` (m) of the ranges."""
        missing = self._missing()
        found = []
        for shift in shifts:
            met = self.ranges(body, shift[None])[0]
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
    radius = float(np.linalg.norm((high - low)[:2])) / 2 + REACH + _AROUND
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
