"""Areas in plan (shapely polygons): set operations on a grid of 0.01 mm.

Without the grid, GEOS can give wrong answers for edges that lie within rounding errors of each other: the
common part of two rooms that only touch came out as one of them.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

Area = Any  # a shapely Polygon or MultiPolygon, maybe empty
GRID = 1e-5  # m


def united(areas: Iterable[Area]) -> Area:
    """The union."""
    valid = [polygons_of(a) for a in areas]
    return shapely.union_all(valid, grid_size=GRID) if valid else shapely.Polygon()


def overlap(a: Any, b: Area) -> Any:
    """The part of an area or line that lies in `b`."""
    return shapely.intersection(a, b, grid_size=GRID)


def difference(a: Area, b: Area) -> Area:
    """The part of `a` outside `b`."""
    return shapely.difference(a, b, grid_size=GRID)


def closed(area: Area, width: float) -> Area:
    """The area with slits and gaps up to `width` metres closed; sides and corners stay as they are."""
    return area.buffer(width / 2, join_style="mitre").buffer(-width / 2, join_style="mitre")


def opened(area: Area, half_width: float) -> Area:
    """The area without what is nowhere `half_width` metres from its outline; corners stay as they are."""
    return area.buffer(-half_width, join_style="mitre").buffer(half_width, join_style="mitre")


def enclosed(area: Area) -> list[Area]:
    """What the area encloses, as polygons: the parts of its surroundings that do not lie outside."""
    if area.is_empty:
        return []
    around = area.envelope.buffer(1.0)
    parts = shapely.get_parts(difference(around, area))
    return [p for p in parts if not p.intersects(around.exterior)]


def polygons_of(area: Any) -> Area:
    """The areal part of a geometry, made valid."""
    area = area if area.is_valid else shapely.make_valid(area)
    if area.geom_type in ("Polygon", "MultiPolygon"):
        return area
    parts = [p for p in shapely.get_parts(area) if p.geom_type in ("Polygon", "MultiPolygon")]
    return shapely.union_all(parts, grid_size=GRID) if parts else shapely.Polygon()


def triangles_of(area: Area) -> NDArray[np.float64]:
    """(M, 3, 2) triangles that cover the area, between its corners."""
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(area))
    return np.asarray(corners.reshape(-1, 4, 2)[:, :3])


def largest(area: Area) -> Area:
    """The largest of a geometry's polygons."""
    return max(shapely.get_parts(area), key=lambda p: p.area, default=shapely.Polygon())
