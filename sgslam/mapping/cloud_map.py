"""The point cloud map: the keyframes' points at the final poses, averaged in each voxel."""

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping.keyframe_clouds import KeyframeClouds, voxel_keys

Floats = NDArray[np.float64]
_BATCH = 1_000_000  # points merged into the map at once


class VoxelMap:
    """The mean of the points in each voxel, and of what is known of each. Memory grows with the occupied voxels, not
    with the points."""

    def __init__(self, voxel: float, origin: Floats, values: int = 0) -> None:
        """`voxel` is the side of a voxel (m); points must lie within a million voxels of `origin` (3,); so many
        `values` are known of each point."""
        self._voxel, self._origin = voxel, origin
        self._keys = np.empty(0, np.int64)
        self._sums = np.empty((0, 4 + values))  # x, y, z relative to the origin, the values, the number of points
        self._waiting: list[Floats] = []

    def add(self, points: Floats, values: Floats | None = None) -> None:
        """Adds points (N, 3) with their values (N, K)."""
        near = points - self._origin
        self._waiting.append(near if values is None else np.column_stack([near, values]))
        if sum(map(len, self._waiting)) >= _BATCH:
            self._merge()

    def _merge(self) -> None:
        points = np.concatenate([np.empty((0, self._sums.shape[1] - 1)), *self._waiting])
        self._waiting = []
        weighted = np.concatenate([self._sums, np.column_stack([points, np.ones(len(points))])])
        keys = np.concatenate([self._keys, voxel_keys(points[:, :3], self._voxel)])
        self._keys, place = np.unique(keys, return_inverse=True)
        self._sums = np.stack([np.bincount(place, column, len(self._keys)) for column in weighted.T], axis=1)

    def points(self) -> Floats:
        """(M, 3) one point for each occupied voxel."""
        self._merge()
        return np.asarray(self._sums[:, :3] / self._sums[:, -1:] + self._origin)

    def values(self) -> Floats:
        """(M, K) the means of their values."""
        self._merge()
        return np.asarray(self._sums[:, 3:-1] / self._sums[:, -1:])


def cloud_map(clouds: KeyframeClouds, poses: dict[int, Floats], voxel: float) -> tuple[Floats, Floats]:
    """(M, 3) the map in the frame of `poses`: (4, 4) T_frame_sensor by keyframe number; other clouds are left out.

    And (M, 3) unit vectors from its points towards the sensor that saw them, in the mean.
    """
    known = [keyframe for keyframe in clouds if keyframe in poses]
    if not known:
        return np.empty((0, 3)), np.empty((0, 3))
    grown = VoxelMap(voxel, np.floor(poses[known[0]][:3, 3]), values=3)
    for keyframe in known:
        T = poses[keyframe]
        rays = clouds[keyframe] @ T[:3, :3].T
        grown.add(rays + T[:3, 3], -rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9))
    towards = grown.values()
    return grown.points(), towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
