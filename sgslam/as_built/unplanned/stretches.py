"""Returns that nothing planned explains, and the stretches of mapped wall surfaces at which they lie, by wall."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from data.scene_graph import WallSurface
from sgslam.as_built.elements import Finding
from sgslam.as_built.elements.likelihoods import LEAST_VIEWS
from sgslam.as_built.elements.rays import SeenRays
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
GRID = 5 * SENSOR.range_noise  # m, side of a cell: as far apart as the points of a keyframe
_MOST = 2**20  # cells along an axis
# towards which something that stands there is looked for
_AROUND = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)])
_GAP = 0.35  # m along a surface without a return, which does not end a stretch
_LEVELS = 2  # cells above each other that show an upright thing


def unexplained(rays: SeenRays, solids: Sequence[PlannedElement], found: Sequence[Finding], others: Floats) -> Floats:
    """(N, 3) the middles of the cells, metres in the BIM frame, in which enough keyframes met something that is neither
    one of the solids, where they were planned or `found`, nor one of the `others` (M, 3, 3), bodies that are planned
    besides and not judged."""
    if not rays.views:
        return np.empty((0, 3))
    origin = np.floor(rays.views[0].sensor)
    cells, counts = np.unique(
        np.concatenate([_off_plan(rays, k, origin) for k in range(len(rays.views))]), return_counts=True
    )
    middles = origin + _middles(cells[counts >= LEAST_VIEWS])
    bodies = [others, *(body for pair in zip(solids, found, strict=True) for body in _standing(*pair))]
    triangles = np.concatenate(bodies)
    if not len(middles) or not len(triangles):
        return middles
    scene = TriangleScene(triangles)
    directions = _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
    near = np.zeros(len(middles), dtype=bool)
    for direction in directions:
        left = np.flatnonzero(~near)
        near[left] = scene.distances(middles[left], direction) < SENSOR.apart
    return middles[~near]


def _off_plan(rays: SeenRays, number: int, origin: Floats) -> Ints:
    """The numbers of the cells about the `origin` (3,) in which a view met what is not planned there, each once."""
    direction, measured, planned, face = rays.of_view(number)
    cosine = np.ones(len(face))
    met = face >= 0
    cosine[met] = np.abs(np.sum(rays.normal[face[met]] * direction[met], axis=1))
    off = np.where(met, np.abs(planned - measured) * cosine, np.inf) > GRID
    kept = off & (measured < SENSOR.furthest)
    cell = np.floor((rays.views[number].sensor - origin + measured[kept, None] * direction[kept]) / GRID).astype(
        np.int64
    )
    packed = cell + _MOST // 2
    return np.unique((packed[:, 0] * _MOST + packed[:, 1]) * _MOST + packed[:, 2])


def _middles(cells: Ints) -> Floats:
    x, y, z = cells // _MOST**2, cells // _MOST % _MOST, cells % _MOST
    return np.asarray((np.column_stack([x, y, z]) - _MOST // 2 + 0.5) * GRID)


def _standing(element: PlannedElement, found: Finding) -> list[Floats]:
    """The body of an element where it is planned, and where it was found; none of what is absent."""
    if found.verdict == "absent":
        return []
    if found.offset is None or found.direction is None or abs(found.offset) > BUILDING.displaced:
        return [element.triangles]
    return [element.triangles, element.triangles + found.offset * np.array(found.direction)]


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of the mapped surface `id` of the map's `floor`, metres in the BIM frame: its ends `first` and `last`
    (2,), the left one (looking along its `normal` (2,), towards where it was seen from) first; lowest and highest z."""

    id: str
    floor: str
    first: Floats
    last: Floats
    normal: Floats
    height: tuple[float, float]

    @property
    def length(self) -> float:
        """m, in plan view."""
        return float(np.linalg.norm(self.last - self.first))

    def box(self) -> Floats:
        """(4, 3) its corners."""
        return np.array([[*xy, z] for xy in (self.first, self.last) for z in self.height])

    def holds(self, places: Floats, around: float) -> NDArray[np.bool_]:
        """(N,) which places (N, 3) lie on it, or within `around` (m) of it."""
        tangent = np.array([-self.normal[1], self.normal[0]])
        away = places[:, :2] - self.last
        along, low, high = away @ tangent, *self.height
        level = (places[:, 2] > low - around) & (places[:, 2] < high + around)
        beside = (along > -around) & (along < self.length + around)
        return np.asarray(level & beside & (np.abs(away @ self.normal) < around))


def stretches_of(surface: WallSurface, T_bim_map: Floats, floor_z: float, cells: Floats) -> list[Stretch]:
    """Those of a mapped surface; `floor_z` is the z of its floor in the map, `cells` (N, 3) as of `unexplained`."""
    n = T_bim_map[:2, :2] @ surface.normal
    n = n / np.linalg.norm(n)
    tangent = np.array([-n[1], n[0]])
    first, last = ((T_bim_map @ [*end, floor_z, 1.0])[:2] for end in surface.ends())
    bottom = float((T_bim_map @ [*surface.centroid, floor_z, 1.0])[2])
    away = cells[:, :2] - last
    along = away @ tangent
    length = float(np.linalg.norm(first - last))
    low, high = surface.height or (0.0, np.inf)
    own = (np.abs(away @ n) < SENSOR.apart) & (along > 0) & (along < length)
    own &= (cells[:, 2] > bottom + low - GRID) & (cells[:, 2] < bottom + high + GRID)
    along, z = along[own], cells[own, 2]
    place, level = np.floor(along / GRID).astype(np.int64), np.floor(z / GRID).astype(np.int64)
    columns, count = np.unique(np.unique(np.column_stack([place, level]), axis=0)[:, 0], return_counts=True)
    columns = columns[count >= _LEVELS]
    if not len(columns):
        return []
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > _GAP / GRID) + 1)
    found = []
    for run in runs:
        begin, end = GRID * run[0], GRID * (run[-1] + 1)
        if end - begin >= BUILDING.least_thing:
            heights = z[(along >= begin) & (along <= end)]
            height = float(heights.min()) - GRID / 2, float(heights.max()) + GRID / 2
            ends = last + end * tangent, last + begin * tangent
            found.append(Stretch(surface.id, surface.floor or "", *ends, n, height))
    return found


def is_seen_through(stretch: Stretch, rays: SeenRays, above: float = 0.0) -> bool:
    """Whether more rays pass its place than end there; or that of something up to `above` (m) on top of it."""
    near = rays.crossing(stretch.box(), above)
    tangent = np.array([-stretch.normal[1], stretch.normal[0]])
    cosine = near.direction[:, :2] @ stretch.normal
    towards = np.abs(cosine) > 0.1
    near, cosine = near[towards], cosine[towards]
    ranges = (stretch.last - near.origin[:, :2]) @ stretch.normal / cosine
    crossed = near.at(ranges)
    along = (crossed[:, :2] - stretch.last) @ tangent
    low, high = stretch.height if above == 0.0 else (stretch.height[1], stretch.height[1] + above)
    within = (along > GRID) & (along < stretch.length - GRID) & (crossed[:, 2] > low) & (crossed[:, 2] < high)
    within &= ranges > 0
    depth = ((near.measured - ranges) * np.abs(cosine))[within]
    at, through = np.abs(depth) < SENSOR.apart, depth > 2 * SENSOR.apart
    return bool(through.sum() > at.sum())


def one_wall_each(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    """The stretches by the wall that they show; the walls in the order of their first ones."""
    walls: list[list[Stretch]] = []
    for stretch in stretches:
        same = [wall for wall in walls if any(_same_wall(stretch, other) for other in wall)]
        joined = [*(other for wall in same for other in wall), stretch]
        at = next((k for k, wall in enumerate(walls) if wall in same), len(walls))
        walls = [*walls[:at], joined, *(wall for wall in walls[at:] if wall not in same)]
    return walls


def is_two_sided(wall: Sequence[Stretch]) -> bool:
    """Whether a wall's stretches show both its faces."""
    return any(float(stretch.normal @ wall[0].normal) < 0 for stretch in wall)


def _same_wall(a: Stretch, b: Stretch) -> bool:
    """Whether two are pieces of one line, or back to back no further apart than a wall is thick."""
    n = a.normal
    facing = float(n @ b.normal)
    if abs(facing) < np.cos(BUILDING.one_wall):
        return False
    tangent = np.array([-n[1], n[0]])
    one, other = (np.sort([own.first @ tangent, own.last @ tangent]) for own in (a, b))
    gap = max(one[0], other[0]) - min(one[1], other[1])
    across = float(((b.first + b.last) - (a.first + a.last)) @ n) / 2
    if facing > 0:
        return bool(abs(across) < GRID and gap < BUILDING.widest_door)
    return bool(-BUILDING.thickest_wall < across < GRID and gap < -GRID)
