"""The keyframes' points on the page: of each keyframe only the voxels that are new, so that a long run stays light."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sgslam.geometry.frames import transform_points
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import voxel_keys
from sgslam.viewer.canvas import Canvas

Floats = NDArray[np.float64]
_VOXEL = 0.1  # m; one point is shown per voxel
_MOST = 600_000  # points in total
# m above the sensor, and colours there; between 3 m below and the highest are shown: ceilings would hide the rooms
_COLOURS = {-1.0: (70, 84, 112), -0.2: (94, 143, 177), 0.9: (190, 214, 220)}


class ScanClouds:
    """Shows clouds as `<floor>/scans/k<number>` under `/map`, each at its keyframe's pose."""

    def __init__(self, page: Canvas) -> None:
        self._page = page
        self._clouds: KeyframeClouds | None = None
        self.clear()

    def clear(self) -> None:
        """Forgets all clouds, which the scene removes."""
        self._keys = np.empty(0, dtype=np.int64)
        self._processed = 0  # keyframes
        self._names: dict[int, str] = {}

    def show(
        self, clouds: KeyframeClouds, poses: Floats, floors: Sequence[str | None], most: int | None = None
    ) -> None:
        """Shows the clouds of keyframes with poses (K, 4, 4) T_map_sensor; at most `most` new ones."""
        if clouds is not self._clouds:
            for name in self._names.values():
                self._page.remove(name)
            self.clear()
            self._clouds = clouds
        for number, name in self._names.items():
            self._page.frame(name, poses[number])
        end = len(poses) if most is None else min(len(poses), self._processed + most)
        for number in range(self._processed, end):
            points = self._fresh(clouds[number], poses[number])
            if len(points):
                name = f"/map/{floors[number] or 'stairs'}/scans/k{number}"
                self._names[number] = name
                self._page.points(name, points, by_height(points @ poses[number][2, :3]), poses[number])
        self._processed = end

    def up_to(self, keyframe: int) -> None:
        """Hides the clouds of later keyframes."""
        for number, name in self._names.items():
            self._page.hide(name, number > keyframe)

    def _fresh(self, points: NDArray[np.float32], T_map_sensor: Floats) -> NDArray[np.float32]:
        """The points of (N, 3) in voxels without points of earlier keyframes."""
        if not len(points) or len(self._keys) > _MOST:
            return points[:0]
        over = points @ T_map_sensor[2, :3]
        points = points[(over < max(_COLOURS)) & (over > -3.0)]
        keys = voxel_keys(transform_points(T_map_sensor, points), _VOXEL)
        place = np.searchsorted(self._keys, keys)
        known = np.append(self._keys, -1)[place] == keys
        own, first = np.unique(keys[~known], return_index=True)
        self._keys = np.sort(np.concatenate([self._keys, own]), kind="stable")  # two sorted runs: quickly merged
        return points[~known][first]


def by_height(over: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(N, 3) colours of points at heights `over` (N,) above the sensor (m)."""
    channels = [np.interp(over, [*_COLOURS], [colour[k] for colour in _COLOURS.values()]) for k in range(3)]
    return np.stack(channels, axis=1).astype(np.uint8)
