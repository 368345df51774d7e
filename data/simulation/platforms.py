"""Raised floors in some rooms, and the way over them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from data.geometry.areas import triangles_of
from data.geometry.raycast import TriangleScene
from data.simulation.route import SPACING
from data.simulation.storey_model import Space, StoreyModel

Array = NDArray[np.float64]
RISE = 0.3  # m
SHARE = 0.4  # of the rooms
FROM_WALLS = 0.4  # m that stay at the floor's height, so that no lintel is over a platform
HEADROOM = 2.4  # m: there is none under what hangs lower
SAMPLE = 0.2  # m between the places at which that is looked for
KNEE = 0.5  # m
SMOOTH = 0.12  # m along the way: over half a step the sensor rises


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
    free = scene.distances(eyes, np.tile([0.0, 0.0, 1.0], (len(places), 1)))
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
