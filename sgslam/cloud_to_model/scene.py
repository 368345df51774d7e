"""A run as geometries of Open3D."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.cloud_to_model.library import load_open3d

Floats = NDArray[np.float64]
_WALL, _WAY, _CLOUD = (0.0, 0.45, 0.7), (0.84, 0.37, 0.0), (0.6, 0.6, 0.6)


def open3d_scene(
    points: Floats, positions: Floats, rectangles: Sequence[Floats], rgb: NDArray[np.uint8] | None = None
) -> list[Any]:
    """A PointCloud of the map's points (N, 3), a LineSet of the sensor's positions (M, 3), and one of walls, each four
    corners (4, 3): the two lower ends, then the upper ones. `rgb` (N, 3) are the points' colours.

    They are what `open3d.visualization.draw_geometries` takes. Raises UserError where Open3D is missing.
    """
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points)))
    if rgb is None:
        cloud.paint_uniform_color(_CLOUD)
    else:
        cloud.colors = o3d.utility.Vector3dVector(rgb / 255.0)
    steps = np.column_stack([np.arange(len(positions) - 1), np.arange(1, len(positions))])
    way = _lines(o3d, positions, steps, _WAY)
    corners = np.concatenate([np.empty((0, 3)), *rectangles])
    edges = np.array([(0, 1), (1, 3), (3, 2), (2, 0)])
    walls = _lines(o3d, corners, (edges + 4 * np.arange(len(rectangles))[:, None, None]).reshape(-1, 2), _WALL)
    return [cloud, way, walls]


def _lines(o3d: Any, points: Floats, pairs: NDArray[np.int64], colour: tuple[float, float, float]) -> Any:
    ends = o3d.utility.Vector2iVector(pairs.reshape(-1, 2).astype(np.int32))
    lines = o3d.geometry.LineSet(o3d.utility.Vector3dVector(np.array(points)), ends)  # a copy: it must be writeable
    lines.paint_uniform_color(colour)
    return lines
