"""The reveal of a planned opening, where rays cross its wall around it, and the likelihood of the place of a jamb.

The reveal is the cuboid between the two faces of the wall that is cut out. Depths are metres behind the near face; the
place of a jamb is metres from the planned one into the opening.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.likelihoods import UPRIGHT, crossing_blur, densest
from sgslam.as_built.elements.rays import CELL, Rays, View
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_MOST = 4  # rays of a bin; more of them cross at the same place


@dataclass(frozen=True)
class Reveal:
    """Unit vectors `across` and `along` (3,) the wall, BIM frame; metres along `across` of the wall's `faces`, the
    lower first, metres along `along` of the jambs `start` and `end`, z of `bottom` and `top`. `set_back` is how far (m)
    the planned leaf or pane lies behind each face, None where the plan does not tell."""

    across: Floats
    along: Floats
    faces: tuple[float, float]
    start: float
    end: float
    bottom: float
    top: float
    set_back: tuple[float | None, float | None]

    @property
    def depth(self) -> float:
        """Metres from face to face."""
        return self.faces[1] - self.faces[0]

    @property
    def width(self) -> float:
        """Metres from jamb to jamb."""
        return self.end - self.start


def reveal_of(opening: PlannedElement, wall: PlannedElement) -> Reveal | None:
    """None where the wall has no two upright faces around the opening, as a roof has none."""
    body = opening.triangles.reshape(-1, 3)
    low, high = body.min(axis=0) - BUILDING.around, body.max(axis=0) + BUILDING.around
    corners = wall.triangles
    around = np.all((corners.min(axis=1) < high) & (corners.max(axis=1) > low), axis=1)
    faces, normals, areas = _upright(corners[around])
    if not len(faces):
        return None
    parallel = np.abs(normals @ normals.T) > BUILDING.parallel
    across = normals[np.argmax(parallel @ areas)]
    across = across * (1.0 if tuple(across) > tuple(-across) else -1.0)
    along = np.array([-across[1], across[0], 0.0])
    places = faces[np.abs(normals @ across) > BUILDING.parallel].mean(axis=1) @ across
    cut = body @ across
    places = places[(places > cut.min() - SENSOR.edge) & (places < cut.max() + SENSOR.edge)]
    if not len(places) or np.ptp(places) < BUILDING.thinnest_wall:
        return None
    ends = float(places.min()), float(places.max())
    u, z = body @ along, body[:, 2]
    extent = float(u.min()), float(u.max()), float(z.min()), float(z.max())
    return Reveal(across, along, ends, *extent, _set_back(opening.filling, across, ends))


def _upright(triangles: Floats) -> tuple[Floats, Floats, Floats]:
    """Upright triangles (M, 3, 3), their level unit normals (M, 3), and their areas (M,)."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    areas = np.linalg.norm(normals, axis=1)
    upright = (areas > 0) & (np.abs(normals[:, 2]) < UPRIGHT * areas)
    normals = normals[upright] * [1.0, 1.0, 0.0]
    return triangles[upright], normals / np.linalg.norm(normals, axis=1, keepdims=True), areas[upright]


def _set_back(filling: Floats | None, across: Floats, faces: tuple[float, float]) -> tuple[float | None, float | None]:
    """How far the largest part of the filling lies behind each face, without its frame and its handles."""
    if filling is None or not len(filling):
        return None, None
    triangles, normals, areas = _upright(filling)
    facing = np.abs(normals @ across) > BUILDING.parallel
    if not facing.any():
        return None, None
    places, areas = triangles[facing].mean(axis=1) @ across, areas[facing]
    order = np.argsort(places)
    shares = np.cumsum(areas[order]) / areas.sum()
    lower, upper = (float(places[order][np.searchsorted(shares, share)]) for share in (0.25, 0.75))
    return lower - faces[0], faces[1] - upper


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


def crossed_walls(reveal: Reveal, host: int, shift: float | None, rays: Rays, views: list[View]) -> list[CrossedWall]:
    """What both sides tell, of those from which anything was seen. The wall was found `shift` metres off its place,
    along `across`, None if unknown; its face is looked for beside the opening."""
    sides = (_side(reveal, face, host, shift, rays, views) for face in (0, 1))
    return [side for side in sides if side is not None and len(side.view)]


def _side(
    reveal: Reveal, face: int, host: int, shift: float | None, rays: Rays, views: list[View]
) -> CrossedWall | None:
    towards = _Towards.of(reveal, face, rays)
    depth, u, up = towards.crossed(reveal, 0.0)
    beside = (
        towards.on_face(host) & _level(reveal, up) & ~_close(reveal, u, 0.0) & _close(reveal, u, 2 * BUILDING.displaced)
    )
    inward = 1.0 if face == 0 else -1.0
    offset = _offset(depth[beside], None if shift is None else shift * inward)
    depth, u, up = towards.crossed(reveal, offset)
    slope = towards.rays.direction / towards.cosine[:, None] * reveal.depth
    in_opening = (u > 0) & (u < reveal.width) & _level(reveal, up + slope[:, 2])
    kept = _level(reveal, up) & _close(reveal, u, BUILDING.displaced) & (in_opening | towards.on_face(host))
    kept &= depth > -3 * SENSOR.range_noise
    chosen = np.flatnonzero(kept)
    chosen, weight = _few_of_each_bin(chosen, towards.rays.view[chosen], u[chosen])
    rays, u, depth = towards.rays[chosen], u[chosen], depth[chosen]
    near = (towards.before[chosen] + offset) / towards.cosine[chosen]
    cell = np.floor(np.column_stack([u, up[chosen] - reveal.bottom]) / CELL).astype(np.int64)
    blur = crossing_blur(views, rays.view, reveal.along, near, rays.measured)
    far, through = u + slope[chosen] @ reveal.along, depth > reveal.depth + 2 * SENSOR.range_noise
    return CrossedWall(face, rays.view, u, far, reveal.width, depth, blur, weight, cell, through)


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


def _few_of_each_bin(chosen: NDArray[np.int64], view: NDArray[np.int64], u: Floats) -> tuple[NDArray[np.int64], Floats]:
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
    middle, reach = (0.0, BUILDING.displaced) if expected is None else (expected, SENSOR.edge)
    near, far = middle - reach, middle + reach
    depth = depth[(depth > near - SENSOR.range_noise) & (depth < far + SENSOR.range_noise)]
    if not len(depth):
        return 0.0 if expected is None else expected
    tries = np.arange(near, far, SENSOR.range_noise / 2)
    most = densest(depth, tries)
    return float(np.median(depth[np.abs(depth - most) < 2 * SENSOR.range_noise]))
