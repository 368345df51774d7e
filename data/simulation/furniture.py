"""What stands in a building beside its plan: shelves, cupboards and tables along walls, and door leaves, all as upright
boxes; raised floors in some rooms, and the way over them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from data.geometry.areas import triangles_of
from data.geometry.raycast import BOX_FACES, TriangleScene
from data.simulation.route import CELL, SPACING, Grid, Planner
from data.simulation.storey_model import Space, StoreyModel

Array = NDArray[np.float64]
SPOT = CELL / 2  # m between the points of a footprint
PIECES = (  # depth, width, lowest and highest z above the floor, m
    ((0.3, 0.45), (0.8, 2.4), 0.0, (1.6, 1.9)),  # shelf
    ((0.4, 0.6), (0.8, 1.6), 0.0, (0.8, 1.4)),  # cupboard
    ((0.6, 0.8), (1.2, 1.8), 0.68, (0.72, 0.76)),  # table top
)
EACH = 3.0  # m2 of a room for each piece
MOST = 8  # pieces in a room
TRIES = 12  # places tried for each piece
DOORWAY = 1.0  # m about a door's middle that stays free
THICK, FRAME = 0.04, 0.05  # m: a leaf's thickness; the frame's width on each side and above
PASSED = 0.6  # m: a way that comes so near to a door's middle leads through
ONE_LEAF = 1.4  # m: a wider door has two leaves
BESIDE = 0.2  # m that a leaf keeps from the way
AJAR_DEG = (20.0, 75.0)
RISE = 0.3  # m
SHARE = 0.4  # of the rooms
FROM_WALLS = 0.4  # m that stay at the floor's height, so that no lintel is over a platform
HEADROOM = 2.4  # m: there is none under what hangs lower
SAMPLE = 0.2  # m between the places at which that is looked for
KNEE = 0.5  # m
SMOOTH = 0.12  # m along the way: over half a step the sensor rises


@dataclass(frozen=True, eq=False)
class UprightBox:
    """A box on the rectangle about `centre` (2,) with the half `sides` (2, 2), from z `low` to `high`; metres."""

    centre: Array
    sides: Array
    low: float
    high: float

    @property
    def triangles(self) -> Array:
        """(12, 3, 3)."""
        u, v, top = np.array([[u, v, top] for u in (-1, 1) for v in (-1, 1) for top in (0, 1)], dtype=float).T
        xy = self.centre + np.column_stack([u, v]) @ self.sides
        return np.asarray(np.column_stack([xy, self.low + (self.high - self.low) * top])[BOX_FACES])

    @property
    def footprint(self) -> Array:
        """(N, 2) points all over the rectangle, at most SPOT apart."""
        counts = np.ceil(2 * np.linalg.norm(self.sides, axis=1) / SPOT).astype(int) + 1
        u, v = np.meshgrid(*(np.linspace(-1, 1, count) for count in counts))
        return np.asarray(self.centre + np.column_stack([u.ravel(), v.ravel()]) @ self.sides)


def furniture(planner: Planner, way: Array, rng: np.random.Generator) -> list[Array]:
    """The triangles of pieces that keep clear of the way (N, 2), and of doors."""
    grid, model = planner.grid, planner.model
    trees = [(cKDTree(way), planner.need)]
    if model.doors:
        middles = [door.reshape(-1, 3)[:, :2].mean(axis=0) for door in model.doors]
        trees.append((cKDTree(np.stack(middles)), DOORWAY))
    pieces: list[Array] = []
    taken = np.zeros_like(grid.room, dtype=bool)
    for k in range(len(model.spaces)):
        cells = np.argwhere((grid.room == k) & (grid.clearance > 0) & (grid.clearance < 0.45))
        if not len(cells):
            continue
        for _ in range(min(MOST, int((grid.room == k).sum() * CELL**2 / EACH))):
            depths, widths, low, tops = PIECES[rng.choice(len(PIECES), p=(0.5, 0.25, 0.25))]
            for row, column in cells[rng.integers(len(cells), size=TRIES)].tolist():
                size = rng.uniform(*depths), rng.uniform(*widths)
                box = _against_wall(grid, row, column, *size, model.level + low, model.level + rng.uniform(*tops))
                if box is not None and _has_place(grid, box, trees, taken):
                    pieces.append(box.triangles)
                    break
    return pieces


def _has_place(grid: Grid, box: UprightBox, trees: list[tuple[cKDTree, float]], taken: NDArray[np.bool_]) -> bool:
    """Whether a piece stands free of walls, of the trees' places and of other pieces; then its cells are taken."""
    spots = box.footprint
    at = tuple(np.clip(grid.to_cells(spots), 0, np.array(grid.room.shape) - 1).T)
    stands = grid.clearance[at].min() > 0 and not taken[at].any()
    if not stands or not all(tree.query(spots)[0].min() > far for tree, far in trees):
        return False
    taken[at] = True
    return True


def _against_wall(
    grid: Grid, row: int, column: int, depth: float, width: float, low: float, high: float
) -> UprightBox | None:
    """A box with its back to the wall near a cell; None where the wall has no clear direction."""
    around = grid.clearance[row - 1 : row + 2, column - 1 : column + 2]
    if around.shape != (3, 3):
        return None
    away = np.array([around[:, 2].sum() - around[:, 0].sum(), around[2].sum() - around[0].sum()])
    if (length := float(np.linalg.norm(away))) < 3 * CELL:  # a corner, or the middle between two walls
        return None
    away /= length
    wall = grid.to_xy(np.array([row, column])) - (grid.clearance[row, column] - CELL) * away
    along = np.array([-away[1], away[0]])
    return UprightBox(wall + (depth / 2 + 0.01) * away, np.stack([depth / 2 * away, width / 2 * along]), low, high)


def door_leaves(doors: Sequence[Array], way: Array, rng: np.random.Generator) -> list[Array]:
    """The triangles of the leaves of doors, themselves triangles (M, 3, 3) each, beside a way (N, 2); a leaf that would
    be in the way is left out."""
    tree = cKDTree(way)
    leaves: list[Array] = []
    for door in doors:
        outline = _outline(door)
        if outline is None:
            continue
        middle, along, across = outline
        passed = tree.query(middle)[0] < PASSED
        angle = np.radians(90.0 if passed else rng.choice([0.0, rng.uniform(*AJAR_DEG)]))
        low, high = float(door[:, :, 2].min()), float(door[:, :, 2].max()) - FRAME
        for hinge, width in _hinges(middle, along, bool(rng.integers(2))):
            tries = [(across, angle), (-across, angle)] + ([] if passed else [(across, 0.0)])
            swung = [UprightBox(*_swung(hinge, width, *how), low, high) for how in tries]
            leaves += [leaf.triangles for leaf in swung if tree.query(leaf.footprint)[0].min() > BESIDE][:1]
    return leaves


def _outline(door: Array) -> tuple[Array, Array, Array] | None:
    """Middle (2,), half the width along the wall (2,), unit vector across; None where the leaf is drawn swung open."""
    around = shapely.oriented_envelope(shapely.multipoints(door.reshape(-1, 3)[:, :2]))
    if around.geom_type != "Polygon":
        return None
    corners = np.asarray(around.exterior.coords)
    sides = sorted(np.diff(corners[:3], axis=0), key=lambda side: -float(np.linalg.norm(side)))
    width, depth = (float(np.linalg.norm(side)) for side in sides)
    if depth > 0.6 * width or width < 0.5:
        return None
    return corners[:4].mean(axis=0), sides[0] / 2, sides[1] / depth


def _hinges(middle: Array, along: Array, other: bool) -> list[tuple[Array, Array]]:
    """Each leaf's hinge (2,) and, from there, its width (2,) when shut."""
    half = along * (1 - FRAME / float(np.linalg.norm(along)))
    if 2 * np.linalg.norm(along) > ONE_LEAF:
        return [(middle - half, half), (middle + half, -half)]
    return [(middle + half, -2 * half)] if other else [(middle - half, 2 * half)]


def _swung(hinge: Array, width: Array, across: Array, angle: float) -> tuple[Array, Array]:
    """Centre (2,) and half sides (2, 2) of a leaf turned to one side."""
    length = float(np.linalg.norm(width))
    leaf = np.cos(angle) * width + np.sin(angle) * length * across
    normal = np.array([-leaf[1], leaf[0]]) / length
    return hinge + leaf / 2, np.stack([leaf / 2, normal * THICK / 2])


@dataclass(frozen=True, eq=False)
class Platforms:
    """Areas of storeys with RISE more height."""

    areas: tuple[tuple[float, shapely.MultiPolygon], ...]  # the storey's level, and where it is raised

    @property
    def triangles(self) -> Array:
        """(M, 3, 3) tops and risers."""
        parts = [_solid(area, level) for level, area in self.areas if not area.is_empty]
        return np.concatenate(parts) if parts else np.empty((0, 3, 3))

    def rise(self, places: Array) -> Array:
        """(N,) metres above the floor at places (N, 3) of the way's ground."""
        rise = np.zeros(len(places))
        for level, area in self.areas:
            near = np.abs(places[:, 2] - level) < RISE
            rise[near] = np.where(shapely.contains_xy(area, places[near, 0], places[near, 1]), RISE, 0.0)
        return rise

    def over(self, leg: Array) -> Array:
        """A leg (N, 3) over the platforms."""
        rise = gaussian_filter1d(self.rise(leg), SMOOTH / SPACING, mode="nearest")
        return leg + rise[:, None] * [0.0, 0.0, 1.0]


def platforms(models: Iterable[StoreyModel], legs: Sequence[Array], scene: TriangleScene, seed: int) -> Platforms:
    """Raises the floor of SHARE of the rooms, of one at least that the way's legs (N, 3) enter; `scene` is
    the building."""
    rng, way, areas = np.random.default_rng([seed, 52]), np.concatenate(legs)[:, :2], []
    for model in models:
        rooms = [area for space in model.spaces if not (area := _inner(space, model.level, scene)).is_empty]
        entered = [shapely.contains_xy(area, way[::20, 0], way[::20, 1]).any() for area in rooms]
        chosen = rng.random(len(rooms)) < SHARE
        if any(entered):
            chosen[rng.choice(np.flatnonzero(entered))] = True
        kept = [area for area, take in zip(rooms, chosen, strict=True) if take]
        areas.append((model.level, shapely.union_all(kept) if kept else shapely.MultiPolygon()))
    return Platforms(tuple(areas))


def _inner(space: Space, level: float, scene: TriangleScene) -> shapely.Geometry:
    """Where a room's floor can be raised; empty for rooms that are low, or whose floor is not at the storey's level."""
    if not len(space.bottom) or np.abs(np.median(space.bottom[:, :, 2]) - level) > RISE:
        return shapely.MultiPolygon()
    floor = shapely.union_all([shapely.Polygon(corners).buffer(1e-3) for corners in space.bottom[:, :, :2]])
    area = floor.buffer(-FROM_WALLS, join_style="mitre")
    return area if area.is_empty else area.difference(_low_places(area, level, scene).buffer(FROM_WALLS))


def _low_places(area: shapely.Geometry, level: float, scene: TriangleScene) -> shapely.MultiPoint:
    """The places of a floor at z = `level` over which something is lower than HEADROOM; what ends below KNEE does not
    count."""
    x0, y0, x1, y1 = area.bounds
    places = np.stack(np.meshgrid(np.arange(x0, x1, SAMPLE), np.arange(y0, y1, SAMPLE)), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(area, places[:, 0], places[:, 1])]
    eyes = np.column_stack([places, np.full(len(places), level + KNEE)])
    free = scene.distances(eyes, np.array([0.0, 0.0, 1.0]))
    return shapely.MultiPoint(places[free < HEADROOM - KNEE])


def _solid(area: shapely.Geometry, level: float) -> Array:
    tops = triangles_of(area)
    parts = [np.dstack([tops, np.full(tops.shape[:2], level + RISE)])]
    for polygon in shapely.get_parts(area):
        for ring in (polygon.exterior, *polygon.interiors):
            points = np.asarray(ring.coords)
            low = np.column_stack([points, np.full(len(points), level)])
            high = low + np.array([0.0, 0.0, RISE])
            parts.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
            parts.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return np.concatenate(parts)
