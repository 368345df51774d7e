"""Registers the scans of two passes by a place, with the covariance of the result. GICP (Segal et al., RSS 2009)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import inverse, squared_up, transform_points

Floats = NDArray[np.float64]
_VOXEL = 0.15  # m, of the points that are registered
_NEIGHBOURS = 20  # of a point for its normal; with fewer, noise makes a bare wall seem to constrain along itself
_FEWEST = 50  # points
_CORRELATED, _SIGMA = 100.0, 0.02  # points that share one error; m, its standard deviation
_KNOWN = 0.5  # m to the nearest point of the other pass
_COARSE, _FINE = 0.5, 0.2  # m between corresponding points
_UPRIGHT = float(np.sin(np.radians(10.0)))  # of a wall's normal and the plane: normals of few points err by degrees


@dataclass(frozen=True)
class Registration:
    """`T_target_source` (4, 4), between level frames, with its covariance (6, 6), rotation first, in the source's axes.

    Of the source's points near any of the target, `inliers` is the share within the inlier distance of the target's
    planes, and `error` (m) their RMSE. `held` is the share of inliers that constrain the weakest horizontal direction.
    """

    T_target_source: Floats
    covariance: Floats
    inliers: float
    error: float
    held: float


@dataclass(frozen=True)
class Submap:
    """`points` (N, 3) in one level frame, and from where (N, 3) each was seen."""

    points: Floats
    seen_from: Floats

    @staticmethod
    def of(clouds: list[NDArray[np.float32]], T_map_sensor: Floats, T_map_frame: Floats) -> "Submap":
        """The clouds of K keyframes at T_map_sensor (K, 4, 4), in the frame of T_map_frame (4, 4)."""
        T = inverse(T_map_frame) @ T_map_sensor
        points = [transform_points(pose, cloud.astype(float)) for pose, cloud in zip(T, clouds, strict=True)]
        return Submap(np.concatenate(points), np.repeat(T[:, :3, 3], [len(own) for own in points], axis=0))

    def outward(self, points: Floats, normals: Floats) -> Floats:
        """The normals (M, 3) at points (M, 3), each towards where the nearest point of the submap was seen from."""
        _, nearest = KDTree(self.points).query(points)
        towards = np.sum(normals * (self.seen_from[nearest] - points), axis=1)
        return np.asarray(normals * np.where(towards < 0, -1.0, 1.0)[:, None])


def register(target: Submap, source: Submap, guess: Floats, settings: LoopSettings) -> Registration | None:
    """Registers `source` to `target` from a guess T_target_source (4, 4); None without convergence.

    A surface that the two saw from opposite sides is not the same one: they are the two faces of a wall.
    """
    import small_gicp

    if min(len(target.points), len(source.points)) < _FEWEST:
        return None
    there, tree = small_gicp.preprocess_points(target.points, _VOXEL, _NEIGHBOURS, 1)
    here, _ = small_gicp.preprocess_points(source.points, _VOXEL, _NEIGHBOURS, 1)
    if min(there.size(), here.size()) < _FEWEST:
        return None
    T = guess
    for distance in (_COARSE, _FINE):
        found = small_gicp.align(
            there, here, tree, T, registration_type="GICP", max_correspondence_distance=distance, num_threads=1
        )
        T = squared_up(np.asarray(found.T_target_source))
    if not found.converged or not np.isfinite(T).all():
        return None
    own, theirs = np.asarray(here.points())[:, :3], np.asarray(there.points())[:, :3]
    facing = source.outward(own, np.asarray(here.normals())[:, :3]) @ T[:3, :3].T
    theirs_facing = target.outward(theirs, np.asarray(there.normals())[:, :3])
    placed = transform_points(T, own)
    nearest, squared = tree.batch_nearest_neighbor_search(np.column_stack([placed, np.ones(len(placed))]))
    known = np.asarray(squared) < _KNOWN**2  # the other pass saw nothing further away
    nearest = np.asarray(nearest)[known]
    normals, points = theirs_facing[nearest], theirs[nearest]
    near = np.abs(np.sum(normals * (placed[known] - points), axis=1))
    inlying = (near < settings.inlier_distance) & (np.sum(normals * facing[known], axis=1) > 0)
    inliers = near[inlying]
    if len(inliers) < _FEWEST:
        return None
    H = _information(T, own[known][inlying], normals[inlying])
    return Registration(
        T, _covariance(H, settings), len(inliers) / len(near), float(np.sqrt(np.mean(inliers**2))),
        _held(H) / len(inliers),
    )  # fmt: skip


def _information(T: Floats, points: Floats, normals: Floats) -> Floats:
    """(6, 6) point-to-plane information of a small motion of the source in its own axes, rotation first.

    Points (N, 3) are in the source frame, normals (N, 3) in the target frame. GICP's own information also constrains
    the directions along each surface a little. Walls count as upright, floors and ceilings as level: the errors of many
    normals would wrongly let walls constrain the height.
    """
    along = _squared(normals) @ T[:3, :3]
    J = np.concatenate([np.cross(points, along), along], axis=1)
    return np.asarray(J.T @ J)


def _squared(normals: Floats) -> Floats:
    """Normals (N, 3) in a level frame: those that are nearly level or upright made so."""
    upright, level = np.abs(normals[:, 2]) < _UPRIGHT, np.hypot(normals[:, 0], normals[:, 1]) < _UPRIGHT
    squared = np.where(level[:, None], np.array([0.0, 0.0, 1.0]), normals)
    squared[upright, 2] = 0.0
    return np.asarray(squared / np.linalg.norm(squared, axis=1, keepdims=True))


def _held(H: Floats) -> float:
    """The number of points that constrain the weakest horizontal direction, rotation marginalised."""
    about = H[3:, 3:] - H[3:, :3] @ np.linalg.pinv(H[:3, :3]) @ H[:3, 3:]
    return float(np.linalg.eigvalsh(about[:2, :2])[0])


def _covariance(H: Floats, settings: LoopSettings) -> Floats:
    """(6, 6) covariance from the information H (6, 6), at least that of the settings, wide in free directions.

    Errors of points on one surface are correlated: a hundred points count as one with 2 cm.
    """
    values, vectors = np.linalg.eigh(H / _CORRELATED / _SIGMA**2)
    wide = vectors @ np.diag(1.0 / np.maximum(values, 1e-2)) @ vectors.T
    least = [settings.sigma_rotation**2] * 3 + [settings.sigma_translation**2] * 3
    return np.asarray((wide + wide.T) / 2 + np.diag(least))
