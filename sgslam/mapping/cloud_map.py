"""The point cloud map: the keyframes' points at the final poses, averaged in each voxel."""

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping.keyframe_clouds import KeyframeClouds, voxel_keys

Floats = NDArray[np.float64]
_BATCH = 1_000_000  # points merged into the map at once


class VoxelMap:
    """The mean of the points in each voxel. Memory grows with the occupied voxels, not with the points."""

    def __init__(self, voxel: float, origin: Floats) -> None:
        """`voxel` is the side of a voxel (m); points must lie within a million voxels of `origin` (3,)."""
        self._voxel, self._origin = voxel, origin
        self._keys = np.empty(0, np.int64)
        self._sums = np.empty((0, 4))  # x, y, z relative to the origin, and the number of points
        self._waiting: list[Floats] = []

    def add(self, points: Floats) -> None:
        """Adds points (N, 3)."""
        self._waiting.append(points - self._origin)
        if sum(map(len, self._waiting)) >= _BATCH:
            self._merge()

    def _merge(self) -> None:
        points = np.concatenate([np.empty((0, 3)), *self._waiting])
        self._waiting = []
        weighted = np.concatenate([self._sums, np.column_stack([points, np.ones(len(points))])])
        keys = np.concatenate([self._keys, voxel_keys(points, self._voxel)])
        self._keys, place = np.unique(keys, return_inverse=True)
        self._sums = np.stack([np.bincount(place, column, len(self._keys)) for column in weighted.T], axis=1)

    def points(self) -> Floats:
        """(M, 3) one point for each occupied voxel."""
        self._merge()
        return np.asarray(self._sums[:, :3] / self._sums[:, 3:] + self._origin)


def cloud_map(clouds: KeyframeClouds, poses: dict[int, Floats], voxel: float) -> Floats:
    """(M, 3) the map in the frame of `poses`: (4, 4) T_frame_sensor by keyframe number; other clouds are left out."""
    known = [keyframe for keyframe in clouds if keyframe in poses]
    if not known:
        return np.empty((0, 3))
    grown = VoxelMap(voxel, np.floor(poses[known[0]][:3, 3]))
    for keyframe in known:
        T = poses[keyframe]
        grown.add(clouds[keyframe] @ T[:3, :3].T + T[:3, 3])
    return grown.points()
