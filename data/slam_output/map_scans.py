"""A finished map as scans: its points as the poses saw them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.common.errors import UserError
from data.scans.scan import Scan, ScanSource, finished
from data.trajectory import Trajectory

Floats = NDArray[np.float64]
DISTANCE, ANGLE = 1.0, 1.0  # m, rad between the poses that points are given to
REACH = 20.0  # m, farthest point that is given to a pose
_FEWEST = 20  # points, of a pose that is used
_BINS = np.deg2rad([2.0, 6.0, 18.0])  # of direction, in which near patches hide what is behind them
_BEHIND = 0.1  # m, behind the plane of a patch, from where it hides a point: less than a wall
_AROUND = 8  # nearest points that show a point's patch
_FARTHEST = 0.4  # m, from which nearest points on a point has no patch: it stands alone


class MapScans(ScanSource):
    """Scans made of a map: each point is given to one of the poses, a metre or a radian apart, that could see it.
    `given` holds all poses."""

    stamps_ns: NDArray[np.int64]
    given: Trajectory
    is_dense = False

    def __init__(self, path: Path, given: Trajectory, points: Floats) -> None:
        """`path` is what holds the map, `points` (N, 3) in the frame of the poses. Raises UserError if none could see
        them."""
        super().__init__()
        self.path, self.given = path, given
        places = viewpoints(given.poses, DISTANCE, ANGLE)
        owner = owners(points, given.positions[places], REACH)
        seeing = np.flatnonzero(np.bincount(owner[owner >= 0], minlength=len(places)) >= _FEWEST)
        if not len(seeing):
            raise UserError(f"{path}: no point of the map is in view of any pose; give both in the same frame")
        self._points, self._poses = [points[owner == k] for k in seeing], places[seeing]
        self.stamps_ns = np.array(given.stamps_ns[self._poses])

    def __len__(self) -> int:
        """The number of poses that points are given to."""
        return len(self._poses)

    def _read(self, index: int) -> Scan:
        pose = self.given.poses[self._poses[index]]
        points = (self._points[index] - pose[:3, 3]) @ pose[:3, :3]
        return finished(index, int(self.stamps_ns[index]), points, None, self.path, pose.copy())


def viewpoints(poses: Floats, distance: float, angle: float) -> NDArray[np.intp]:
    """(V,) the indices of poses (N, 4, 4), each `distance` (m) or `angle` (rad) from the one before; the first is
    one."""
    chosen = [0] if len(poses) else []
    for k in range(1, len(poses)):
        last, pose = poses[chosen[-1]], poses[k]
        cosine = (np.sum(last[:3, :3] * pose[:3, :3]) - 1) / 2
        if np.linalg.norm(pose[:3, 3] - last[:3, 3]) >= distance or np.arccos(np.clip(cosine, -1, 1)) >= angle:
            chosen.append(k)
    return np.array(chosen, np.intp)


def owners(points: Floats, places: Floats, reach: float) -> NDArray[np.intp]:
    """(N,) for each point (N, 3) of a map the index of one of the places (V, 3) that could see it; -1 for none.

    A place could see a point within `reach` (m) that no patch of the map hides, and from the side from which the
    nearest such place sees it: a floor is not seen from below, even where the map lacks the ceiling. Among several
    places chance decides, the same way each time. So each point counts once, and yet every place sees what is far;
    given to the nearest places, points would show each of them only the walls beside it.
    """
    if not len(points):
        return np.empty(0, np.intp)
    patches = _patches(points)
    owner, seers = np.full((2, len(points)), -1, np.intp), np.zeros((2, len(points)), np.intp)  # from either side
    nearest, front = np.full(len(points), np.inf), np.zeros(len(points), np.intp)
    rng = np.random.default_rng(0)
    for k, place in enumerate(places):
        away = points - place
        squared = np.einsum("ij,ij->i", away, away)
        near = np.flatnonzero((squared < reach**2) & (squared > 0))
        seen = near[_visible(away[near], np.sqrt(squared[near]), patches.of(near))]
        side = np.where(np.einsum("ij,ij->i", patches.normals[seen], away[seen]) > 0, 1, 0)
        nearer = squared[seen] < nearest[seen]
        nearest[seen[nearer]], front[seen[nearer]] = squared[seen[nearer]], side[nearer]
        seers[side, seen] += 1
        taken = rng.random(len(seen)) * seers[side, seen] < 1  # each of the places so far with equal chance
        owner[side[taken], seen[taken]] = k
    return np.asarray(owner[front, np.arange(len(points))])


@dataclass(frozen=True, eq=False)
class _Patches:
    """The surface around each point: its unit `normals` (N, 3), of either sign, and how far (m) it reaches, (N,)."""

    normals: Floats
    radii: Floats

    def of(self, chosen: NDArray[np.intp]) -> "_Patches":
        return _Patches(self.normals[chosen], self.radii[chosen])


def _patches(points: Floats) -> _Patches:
    """The patch of a point is the plane through its nearest points, as far as they are from one another."""
    nearest = np.arange(1, min(_AROUND + 1, len(points)) + 1)
    apart, neighbours = cKDTree(points).query(points, nearest)
    around = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
    radii = apart[:, -1] / np.sqrt(2.0)  # half of the nearest points are nearer
    return _Patches(normals, np.where(radii < _FARTHEST, radii, 0.0))


def _visible(away: Floats, ranges: Floats, patches: _Patches) -> NDArray[np.bool_]:
    """(M,) whether points in directions `away` (M, 3) at `ranges` (M,) are behind no patch.

    A patch fills a bin of the size at which it appears: where the map is sparse, or near, it is larger than the
    smallest ones.
    """
    shown = np.ones(len(away), np.bool_)
    order = np.argsort(-ranges)  # the nearest of a bin comes last
    for smaller, size in zip((0.0, *_BINS), _BINS, strict=False):
        cells, count = _cells(away, ranges, size)
        hiding = order[patches.radii[order] >= smaller / 2 * ranges[order]]
        first = np.full(count, -1, np.intp)
        first[cells[hiding]] = hiding
        nearest = first[cells]
        normal, place = patches.normals[nearest], away[nearest]
        offset = np.einsum("ij,ij->i", normal, place)
        behind = (np.einsum("ij,ij->i", normal, away) - offset) * np.sign(offset)
        shown &= (nearest < 0) | (behind <= _BEHIND) | (ranges <= ranges[nearest])
    return shown


def _cells(away: Floats, ranges: Floats, size: float) -> tuple[NDArray[np.intp], int]:
    """(M,) the bin of each direction `away` (M, 3), `size` (rad) large, and how many bins there are."""
    rows, columns = int(np.ceil(np.pi / size)) + 1, int(np.ceil(2 * np.pi / size)) + 1
    row = ((np.arcsin(np.clip(away[:, 2] / ranges, -1, 1)) + np.pi / 2) / size).astype(np.intp)
    column = ((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / size).astype(np.intp)
    return row * columns + column, rows * columns
