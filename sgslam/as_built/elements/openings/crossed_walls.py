"""Where rays from one side cross the near face of a wall around an opening, and how far behind it they end."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.as_built.elements.likelihoods import REACH, crossing_blur
from sgslam.as_built.elements.openings.jambs import Crossings
from sgslam.as_built.elements.openings.reveals import Reveal
from sgslam.as_built.elements.rays import Rays, View
from sgslam.as_built.elements.sightings import CELL
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_MOST = 4  # rays of a bin; more of them cross at the same place


@dataclass(frozen=True)
class CrossedWall:
    """N rays that end at the near face or behind it. `face` is the index of that face in `Reveal.faces`; `near`, `far`
    (N,) metres from the `start` jamb at which they enter and leave the wall's slab, `width` the opening's; `depth` (N,)
    metres behind the near face, `blur`, `weight` as in `Crossings`; `cell` (N, 2) along the wall and up; `through`
    (N,), whether they left the wall behind."""

    face: int
    view: NDArray[np.int64]
    near: Floats
    far: Floats
    width: float
    depth: Floats
    blur: Floats
    weight: Floats
    cell: NDArray[np.int64]
    through: Flags

    @property
    def within(self) -> Flags:
        """Which cross the face in the planned opening."""
        return (self.near > SENSOR.edge) & (self.near < self.width - SENSOR.edge)

    def beside(self, along: float) -> Flags:
        """Which cross the face well beside the opening, displaced by so many metres."""
        return (self.near < along - SENSOR.edge) | (self.near > self.width + along + SENSOR.edge)

    def crossings(self, jamb: int) -> Crossings:
        """The rays in the half of the planned opening, and beside it, that tell of its `start` (0) or its end (1)."""
        near, far = (x if jamb == 0 else self.width - x for x in (self.near, self.far))
        own = (near + far < self.width) if jamb == 0 else (near + far <= self.width)
        return Crossings(near[own], far[own], self.depth[own], self.blur[own], self.weight[own])


def crossed_walls(
    reveal: Reveal, host: int, shift: float | None, rays: Rays, views: list[View]
) -> list[CrossedWall]:  # fmt: skip
    """What both sides tell, of those from which anything was seen. The wall was found `shift` metres off its place,
    along `across`, None if unknown; its face is looked for beside the opening."""
    sides = (_side(reveal, face, host, shift, rays, views) for face in (0, 1))
    return [side for side in sides if side is not None and len(side.view)]


def _side(
    reveal: Reveal, face: int, host: int, shift: float | None, rays: Rays, views: list[View]
) -> CrossedWall | None:  # fmt: skip
    towards = _Towards.of(reveal, face, rays)
    depth, u, up = towards.crossed(reveal, 0.0)
    beside = towards.on_face(host) & _level(reveal, up) & ~_close(reveal, u, 0.0) & _close(reveal, u, 2 * REACH)
    inward = 1.0 if face == 0 else -1.0
    offset = _offset(depth[beside], None if shift is None else shift * inward)
    depth, u, up = towards.crossed(reveal, offset)
    slope = towards.rays.direction / towards.cosine[:, None] * reveal.depth
    in_opening = (u > 0) & (u < reveal.width) & _level(reveal, up + slope[:, 2])
    kept = (
        _level(reveal, up)
        & _close(reveal, u, REACH)
        & (in_opening | towards.on_face(host))
        & (depth > -3 * SENSOR.range_noise)
    )
    chosen = np.flatnonzero(kept)
    chosen, weight = _thinned(chosen, towards.rays.view[chosen], u[chosen])
    rays, u, depth = towards.rays[chosen], u[chosen], depth[chosen]
    near = (towards.before[chosen] + offset) / towards.cosine[chosen]
    cell = np.floor(np.column_stack([u, up[chosen] - reveal.bottom]) / CELL).astype(np.int64)
    return CrossedWall(
        face, rays.view, u, u + slope[chosen] @ reveal.along, reveal.width, depth,
        crossing_blur(views, rays.view, reveal.along, near, rays.measured), weight, cell,
        depth > reveal.depth + 2 * SENSOR.range_noise,
    )  # fmt: skip


@dataclass(frozen=True)
class _Towards:
    """Rays from one side towards a face: `cosine` (N,) of their incidence, and how far `before` it they begin (m)."""

    rays: Rays
    cosine: Floats
    before: Floats

    @staticmethod
    def of(reveal: Reveal, face: int, rays: Rays) -> "_Towards":
        sign = 1.0 if face == 0 else -1.0
        cosine = sign * (rays.direction @ reveal.across)
        before = sign * (reveal.faces[face] - rays.origin @ reveal.across)
        good = (cosine > SENSOR.least_cosine) & (before > 0) & (before < SENSOR.furthest * cosine)
        return _Towards(rays[good], cosine[good], before[good])

    def crossed(self, reveal: Reveal, offset: float) -> tuple[Floats, Floats, Floats]:
        """(N,) each, of a face that lies `offset` metres behind its plan: depth of what is met behind it, place along
        the wall from the opening's start, and z, both where the face is crossed (m)."""
        place = self.rays.at((self.before + offset) / self.cosine)
        depth = self.rays.measured * self.cosine - self.before - offset
        return depth, place @ reveal.along - reveal.start, place[:, 2]

    def on_face(self, host: int) -> Flags:
        """Which the plan lets end at the face."""
        return (self.rays.owner == host) & (np.abs(self.rays.planned * self.cosine - self.before) < SENSOR.range_noise)


def _level(reveal: Reveal, z: Floats) -> Flags:
    return (z > reveal.bottom + SENSOR.edge) & (z < reveal.top - SENSOR.edge)


def _close(reveal: Reveal, u: Floats, beside: float) -> Flags:
    return (u > -beside) & (u < reveal.width + beside)


def _thinned(chosen: NDArray[np.int64], view: NDArray[np.int64], u: Floats) -> tuple[NDArray[np.int64], Floats]:
    """At most _MOST rays of each keyframe and bin along the wall, and their weights, which sum up to one in it."""
    _, group = np.unique(np.column_stack([view, np.floor(u / SENSOR.edge)]), axis=0, return_inverse=True)
    group = group.ravel()
    order = np.argsort(group, kind="stable")
    begins = np.searchsorted(group[order], np.arange(group.max(initial=-1) + 1))
    counts = np.bincount(group)
    place = np.arange(len(group)) - begins[group[order]]
    every = np.maximum(1, -(-counts // _MOST))[group[order]]
    kept = order[place % every == 0]
    return chosen[kept], 1 / np.bincount(group[kept], minlength=len(counts))[group[kept]]


def _offset(depth: Floats, expected: float | None) -> float:
    """Metres by which the face lies behind its plan: where most is met beside the opening, near what is expected."""
    near, far = (-REACH, REACH) if expected is None else (expected - SENSOR.edge, expected + SENSOR.edge)
    depth = depth[(depth > near - SENSOR.range_noise) & (depth < far + SENSOR.range_noise)]
    if not len(depth):
        return 0.0 if expected is None else expected
    tries = np.arange(near, far, SENSOR.range_noise / 2)
    most = tries[np.argmax(np.exp(-0.5 * ((depth - tries[:, None]) / SENSOR.range_noise) ** 2).sum(axis=1))]
    return float(np.median(depth[np.abs(depth - most) < 2 * SENSOR.range_noise]))
