"""How firmly the surfaces around it hold a scan, direction by direction, and what that says of the steps between
keyframes: in a bare corridor nothing tells how far along it the robot went, in an open hall nothing at all."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
_CELL = 0.15  # m: the noise of a point is a small part of it
_NEIGHBOURS = 5  # cells that make a piece of a surface
_NEAR = 0.6  # m to the furthest of them


def surfaces_of(points: Floats) -> Floats:
    """(3, 3) the normal equations of yaw, x and y (sensor axes) of a scan's own surfaces, each point (N, 3) counting
    one across the upright surface that it lies on, and nothing along it (point to plane; Zhang, Kaess, Singh, ICRA
    2016 on what their eigenvalues tell). The sensor is roughly level, the points are those on upright surfaces."""
    xy = points[:, :2]
    _, cell, count = np.unique(np.floor(xy / _CELL).astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    if len(count) < _NEIGHBOURS:
        return np.zeros((3, 3))
    cell = cell.ravel()
    centre = np.stack([np.bincount(cell, xy[:, axis]) for axis in (0, 1)], axis=1) / count[:, None]
    distance, nearest = cKDTree(centre).query(centre, _NEIGHBOURS)
    around = centre[nearest] - centre[nearest].mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normal = axes[:, :, 0]
    # a heap of points has no normal; four times as long as wide is a surface
    straight = (distance[:, -1] < _NEAR) & (spread[:, 0] < spread[:, 1] / 16)
    lever = centre[:, 0] * normal[:, 1] - centre[:, 1] * normal[:, 0]
    J = np.column_stack([lever, normal])[straight]
    return np.asarray(J.T @ (J * count[straight, None]))
