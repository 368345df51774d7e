"""Where one pass of a place lies on another one: search in plan view, then registration of the points.

The search is correlative scan matching (Olson, ICRA 2009) on a grid of wall, free and unknown cells, where points in
free cells count against a place. The registration is GICP (Segal et al., RSS 2009).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import inverse, se2_to_se3, squared_up, transform_points
from sgslam.mapping.rooms import Grid

Floats = NDArray[np.float64]
_CELL = 0.1  # m
_REACH = 10.0  # m of each contour that is used; beyond, neighbouring columns are far apart
_WALL, _CLEAR = 0.15, 0.35  # m from a contour: up to here wall, from here on free
_TURN = 0.0175  # rad, step of the search: a cell at six metres
_ELSEWHERE = 0.6, 0.1  # m and rad from the best place, beyond which a place is a different one
_OVERLAP = 0.5  # least share of the points that lie in known space
_VOXEL, _NEIGHBOURS = 0.15, 20  # m; points of a normal: with fewer, noise makes a bare wall hold along itself
_DISTANCES = 0.5, 0.2  # m between corresponding points, at first and at last
_FEWEST = 50  # points of a pass
INLIER = 4 * SENSOR.range_noise  # m between points of one surface, along its normal: both have noise
_UPRIGHT = float(np.sin(np.radians(10.0)))  # of a wall's normal and the plane: normals of few points err by degrees
_CORRELATED = 100.0  # points that share one error, of SENSOR.range_noise


@dataclass(frozen=True)
class SeenSpace:
    """The plan view of one pass: cells are +1 at walls, -1 in free space, 0 where unknown."""

    grid: Grid
    cells: NDArray[np.int8]
    points: Floats  # (N, 2) of its contours, one for each cell

    @staticmethod
    def of(sensors: Floats, contours: list[Floats]) -> "SeenSpace":
        """Draws contours (M, 2) around sensors (K, 2), all in one frame."""
        away = [np.linalg.norm(c - s, axis=1) for s, c in zip(sensors, contours, strict=True)]
        cut = [
            s + (c - s) * np.minimum(1.0, _REACH / np.maximum(own, 1e-9))[:, None]
            for s, c, own in zip(sensors, contours, away, strict=True)
        ]
        grid = Grid.around(np.concatenate([sensors, *cut]), _CELL)
        free, clear_of_walls = np.zeros(grid.shape, np.uint8), np.ones(grid.shape, np.uint8)
        for outline in cut:
            if len(outline) >= 3:
                cv2.fillPoly(free, [grid.to_cells(outline)], 1)
        near = [c[own < _REACH] for c, own in zip(contours, away, strict=True)]
        at = np.unique(grid.to_cells(np.concatenate([np.empty((0, 2)), *near])), axis=0)
        clear_of_walls[at[:, 1], at[:, 0]] = 0
        off = cv2.distanceTransform(clear_of_walls, cv2.DIST_L2, 3) * _CELL if len(at) else np.full(grid.shape, np.inf)
        cells = np.where(off <= _WALL, 1, np.where((free > 0) & (off > _CLEAR), -1, 0)).astype(np.int8)
        return SeenSpace(grid, cells, grid.to_points(at))

    def agreement(self, points: Floats) -> float:
        """The share of the points (N, 2) in known space that are on walls, less the share of those in free space."""
        at = np.rint((points - self.grid.origin) / self.grid.cell).astype(np.int64)
        inside = ((at >= 0) & (at < self.grid.shape[::-1])).all(axis=1)
        value = self.cells[at[inside, 1], at[inside, 0]].astype(np.int64)
        return float(value.sum()) / max(int(np.abs(value).sum()), 1)


@dataclass(frozen=True)
class Fit:
    """The best place of a later pass: `T_there_here` (4, 4) moves it onto the earlier one, in plan view. `agreement` is
    that of `SeenSpace`, `runner_up` that of the best different place."""

    T_there_here: Floats
    agreement: float
    runner_up: float


def search(there: SeenSpace, points: Floats, centre: Floats, drift: float, turn: float) -> Fit | None:
    """The best place of points (N, 2), turned about `centre` (2,) by up to `turn` (rad) and moved by up to `drift` (m)
    in each direction; None without enough points in known space."""
    if len(points) < _FEWEST:
        return None
    turns = np.arange(-np.ceil(turn / _TURN), np.ceil(turn / _TURN) + 1) * _TURN
    moves, half = int(np.ceil(drift / _CELL)), int(np.ceil(np.hypot(*(points - centre).T).max() / _CELL)) + 1
    # the cells around the centre, as far as a point can get
    middle, side = np.rint((centre - there.grid.origin) / _CELL).astype(int), moves + half
    rows, columns = (np.arange(middle[k] - side, middle[k] + side + 1) for k in (1, 0))
    known = np.outer(*((own >= 0) & (own < size) for own, size in zip((rows, columns), there.cells.shape, strict=True)))
    clipped = np.ix_(*(np.clip(own, 0, n - 1) for own, n in zip((rows, columns), there.cells.shape, strict=True)))
    cells = np.where(known, there.cells[clipped], 0).astype(np.float32)
    total, seen = np.empty((2, len(turns), 2 * moves + 1, 2 * moves + 1))
    for number, angle in enumerate(turns):
        c, s = np.cos(angle), np.sin(angle)
        at = np.rint((points - centre) @ np.array([[c, s], [-s, c]]) / _CELL).astype(int) + half
        counts = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
        np.add.at(counts, (at[:, 1], at[:, 0]), 1.0)
        total[number], seen[number] = (cv2.matchTemplate(own, counts, cv2.TM_CCORR) for own in (cells, np.abs(cells)))
    # a small overlap is no evidence, however well it fits
    score = np.where(seen >= _OVERLAP / 2 * len(points), total / np.maximum(seen, 1), -1.0)
    support = np.where(seen >= _OVERLAP * len(points), total, -np.inf)
    k, row, column = (int(own) for own in np.unravel_index(int(support.argmax()), support.shape))
    if not np.isfinite(support[k, row, column]):
        return None
    step = np.arange(-moves, moves + 1)
    off = _CELL * np.hypot(step[:, None] - step[row], step[None] - step[column]) > _ELSEWHERE[0]
    elsewhere = off[None] | (np.abs(turns - turns[k]) > _ELSEWHERE[1])[:, None, None]
    about = se2_to_se3(float(turns[k]), 0.0, 0.0)
    move = centre + _CELL * np.array([step[column], step[row]]) - about[:2, :2] @ centre
    T = se2_to_se3(float(turns[k]), *move.tolist())
    return Fit(T, float(score[k, row, column]), float(np.where(elsewhere, score, -1.0).max()))


@dataclass(frozen=True)
class Submap:
    """`points` (N, 3) in one level frame, and from where (N, 3) each was seen."""

    points: Floats
    seen_from: Floats

    @staticmethod
    def of(clouds: list[NDArray[np.float32]], T_frame_sensor: Floats) -> "Submap":
        """The clouds of K keyframes at T_frame_sensor (K, 4, 4)."""
        points = [transform_points(T, cloud.astype(float)) for T, cloud in zip(T_frame_sensor, clouds, strict=True)]
        return Submap(np.concatenate(points), np.repeat(T_frame_sensor[:, :3, 3], list(map(len, points)), axis=0))

    def outward(self, points: Floats, normals: Floats) -> Floats:
        """The normals (M, 3) at points (M, 3), each towards where the nearest point of the submap was seen from."""
        _, nearest = KDTree(self.points).query(points)
        towards = np.sum(normals * (self.seen_from[nearest] - points), axis=1)
        return np.asarray(normals * np.where(towards < 0, -1.0, 1.0)[:, None])


@dataclass(frozen=True)
class Registration:
    """`T_target_source` (4, 4), between level frames, and its `information` (6, 6), rotation first, in the source's
    axes. `inliers` is the share of the source's points near the target that lie on its surfaces, `held` the share of
    these that constrain the weakest horizontal direction."""

    T_target_source: Floats
    information: Floats
    inliers: float
    held: float


def register(target: Submap, source: Submap, guess: Floats) -> Registration | None:
    """Registers `source` to `target` from a guess T_target_source (4, 4); None without convergence.

    A surface that the two saw from opposite sides is not the same one: they are the two faces of a wall.
    """
    import small_gicp

    there, tree = small_gicp.preprocess_points(target.points, _VOXEL, _NEIGHBOURS, 1)
    here, _ = small_gicp.preprocess_points(source.points, _VOXEL, _NEIGHBOURS, 1)
    if min(there.size(), here.size()) < _FEWEST:
        return None
    T = guess
    for distance in _DISTANCES:
        found = small_gicp.align(
            there, here, tree, T, registration_type="GICP", max_correspondence_distance=distance, num_threads=1
        )
        T = squared_up(np.asarray(found.T_target_source))
    if not found.converged or not np.isfinite(T).all():
        return None
    points, theirs = np.asarray(here.points())[:, :3], np.asarray(there.points())[:, :3]
    facing = source.outward(points, np.asarray(here.normals())[:, :3]) @ T[:3, :3].T
    placed = transform_points(T, points)
    nearest, squared = tree.batch_nearest_neighbor_search(np.column_stack([placed, np.ones(len(placed))]))
    known = np.asarray(squared) < _DISTANCES[0] ** 2  # the other pass saw nothing farther away
    nearest = np.asarray(nearest)[known]
    normals = target.outward(theirs, np.asarray(there.normals())[:, :3])[nearest]
    off = np.abs(np.sum(normals * (placed[known] - theirs[nearest]), axis=1))
    inlying = (off < INLIER) & (np.sum(normals * facing[known], axis=1) > 0)
    if inlying.sum() < _FEWEST:
        return None
    H = _information(T, points[known][inlying], normals[inlying])
    about = H[3:, 3:] - H[3:, :3] @ np.linalg.pinv(H[:3, :3]) @ H[:3, 3:]  # of the motion, whatever the rotation
    held = float(np.linalg.eigvalsh(about[:2, :2])[0]) / inlying.sum()
    return Registration(T, H / _CORRELATED / SENSOR.range_noise**2, float(inlying.mean()), held)


def _information(T: Floats, points: Floats, normals: Floats) -> Floats:
    """(6, 6) point-to-plane information of a small motion of the source in its own axes, rotation first, for points
    (N, 3) in the source frame and normals (N, 3) in the target frame. GICP's own information also constrains the
    directions along each surface. Nearly upright walls count as upright, nearly level floors as level: the errors of
    many normals would wrongly let walls constrain the height."""
    level = np.hypot(normals[:, 0], normals[:, 1]) < _UPRIGHT
    squared = np.where(level[:, None], np.array([0.0, 0.0, 1.0]), normals)
    squared[np.abs(normals[:, 2]) < _UPRIGHT, 2] = 0.0
    along = squared / np.linalg.norm(squared, axis=1, keepdims=True) @ T[:3, :3]
    J = np.concatenate([np.cross(points, along), along], axis=1)
    return np.asarray(J.T @ J)


def covariance_of(found: Registration, T_source_sensor: Floats, least: Floats) -> Floats:
    """(6, 6) the covariance of a registration in the sensor's axes, rotation first, that of free directions wide.
    `least` (6,) are standard deviations that are added."""
    values, vectors = np.linalg.eigh(found.information)
    wide = vectors @ np.diag(1.0 / np.maximum(values, 1e-2)) @ vectors.T + np.diag(least**2)
    turned = np.kron(np.eye(2), inverse(T_source_sensor)[:3, :3])
    covariance = turned @ wide @ turned.T
    return np.asarray((covariance + covariance.T) / 2)
