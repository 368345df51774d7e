"""Walls in a local map that is only a cloud: those that stand free around the place where it begins."""

import numpy as np
from made_input import Array, Sighting

from sgslam.perception.column_scan import split_chains

COLUMNS, DEPTH = 360, 0.15  # directions around; m behind the nearest point of a direction that still belong to it
LOW, HIGH = -0.5, 1.0  # m, heights from the sensor between which walls are looked for
SHORTEST, ROUGHEST = 0.8, 0.03  # m, of a wall, and across it (root mean square)


def walls_around(points: Array, name: str) -> list[Sighting]:
    """Walls in a cloud (N, 3), z up, that are seen from its origin, to which their normals point: `name/0`, ..."""
    points = points[(points[:, 2] > LOW) & (points[:, 2] < HIGH)]
    distance = np.hypot(points[:, 0], points[:, 1])
    column = np.floor((np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) + 0.5) * COLUMNS).astype(np.int64) % COLUMNS
    nearest = np.full(COLUMNS, np.inf)
    np.minimum.at(nearest, column, distance)
    seen = distance < nearest[column] + DEPTH
    xy, column = points[seen, :2], column[seen]
    filled = np.unique(column)
    contour = np.array([np.median(xy[column == c], axis=0) for c in filled]).reshape(-1, 2)
    walls = list[Sighting]()
    for first, last in split_chains(contour, filled, 2 * np.pi / COLUMNS, 0.1):
        own = xy[(column > filled[first]) & (column < filled[last])]  # the outermost may hold points of walls beside
        wall = _fitted(own, f"{name}/{len(walls)}") if len(own) > 20 else None
        if wall is not None:
            walls.append(wall)
    return walls


def _fitted(xy: Array, name: str) -> Sighting | None:
    """The wall through points (N, 2) by principal components; None if it is short or not flat."""
    middle = xy.mean(axis=0)
    _, spread, (along, normal) = np.linalg.svd(xy - middle, full_matrices=False)
    reach = (xy - middle) @ along
    if np.ptp(reach) < SHORTEST or spread[1] / np.sqrt(len(xy)) > ROUGHEST:
        return None
    normal = -normal if normal @ middle > 0 else normal
    centre = middle + along * (reach.max() + reach.min()) / 2
    return Sighting(name, np.array([*normal, 0.0, -normal @ middle]), np.array([*centre, 0.0]), float(np.ptp(reach)))
