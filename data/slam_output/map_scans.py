"""A finished map as scans: its points as the poses saw them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.scan import Scan, ScanSource, finished
from data.slam_output.map_points import owners, viewpoints
from data.trajectory import Trajectory

Floats = NDArray[np.float64]
DISTANCE, ANGLE = 1.0, 1.0  # m, rad between the poses that points are given to
REACH = 20.0  # m, farthest point that is given to a pose
_FEWEST = 20  # points, of a pose that is used


@dataclass(frozen=True, eq=False)
class MapPiece:
    """Points (N, 3) in the frame of the trajectory, and which of its poses (indices) saw them."""

    points: Floats
    seen_by: NDArray[np.intp]


class MapScans(ScanSource):
    """Scans made of the pieces of a map: each point belongs to one of the poses that could see it.

    Points are given to poses that are a metre or a radian apart; `given` holds all poses.
    """

    stamps_ns: NDArray[np.int64]
    given: Trajectory
    is_dense = False

    def __init__(self, path: Path, given: Trajectory, pieces: Sequence[MapPiece]) -> None:
        """`path` is what holds the map. Raises UserError if no pose could see the map's points."""
        super().__init__()
        self.path, self.given = path, given
        parts: dict[int, list[Floats]] = {}
        for piece in pieces:
            places = piece.seen_by[viewpoints(given.poses[piece.seen_by], DISTANCE, ANGLE)]
            owner = owners(piece.points, given.positions[places], REACH)
            for k in np.unique(owner[owner >= 0]).tolist():
                parts.setdefault(int(places[k]), []).append(piece.points[owner == k])
        joined = {pose: np.concatenate(points) for pose, points in sorted(parts.items())}
        kept = {pose: points for pose, points in joined.items() if len(points) >= _FEWEST}
        if not kept:
            raise UserError(f"{path}: no point of the map is in view of any pose; give both in the same frame")
        self._points, self._poses = list(kept.values()), np.array(list(kept), np.intp)
        self.stamps_ns = np.array(given.stamps_ns[self._poses])

    def __len__(self) -> int:
        """The number of poses that points are given to."""
        return len(self._poses)

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        return (partial(self._read, index) for index in range(len(self)))

    def _read(self, index: int) -> Scan:
        pose = self.given.poses[self._poses[index]]
        points = (self._points[index] - pose[:3, 3]) @ pose[:3, :3]
        return finished(index, int(self.stamps_ns[index]), points, None, self.path, pose.copy())
