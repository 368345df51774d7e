"""Helpers for frames: levelling, rigid motions, and planes and points under them."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.geometry import se2

Floats = NDArray[np.float64]


def levelling(up: Floats) -> Floats:
    """(3, 3) the smallest rotation that turns the unit vector `up` (3,) to +z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(up[2])
    if sine < 1e-12:
        return np.eye(3)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix()


def inverse(T: Floats) -> Floats:
    """The inverse of a rigid motion (..., 4, 4)."""
    if T.ndim == 2:  # nearly always, and several times faster
        result = np.eye(4)
        result[:3, :3] = T[:3, :3].T
        result[:3, 3] = -(T[:3, 3] @ T[:3, :3])
        return result
    result = np.zeros_like(T)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R
    result[..., :3, 3] = -(R @ T[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def angle_of(T: Floats) -> float:
    """The angle (rad) of a motion's (4, 4) rotation."""
    return float(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1.0, 1.0)))


def squared_up(T: Floats) -> Floats:
    """A motion (4, 4) with its rotation orthogonal again after rounding errors, by one Newton step."""
    R, result = T[:3, :3], T.copy()
    result[:3, :3] = 1.5 * R - 0.5 * R @ (R.T @ R)
    return result


def is_rigid(T: Floats) -> bool:
    """Whether an array is a finite rigid motion (4, 4), rotation proper to 1e-5."""
    T = np.asarray(T)
    if T.shape != (4, 4) or not np.all(np.isfinite(T)) or not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        return False
    R = T[:3, :3]
    return bool(np.allclose(R @ R.T, np.eye(3), atol=1e-5) and np.linalg.det(R) > 0)


def transform_planes(T_a_b: Floats, planes_in_b: Floats) -> Floats:
    """(..., 4) planes in frame a, of planes (..., 4) in frame b: n_a = R n_b, d_a = d_b - n_a . t."""
    normal = (T_a_b[..., :3, :3] @ planes_in_b[..., :3, None])[..., 0]
    offset = planes_in_b[..., 3] - np.sum(normal * T_a_b[..., :3, 3], axis=-1)
    return np.concatenate([normal, offset[..., None]], axis=-1)


def transform_points(T_a_b: Floats, points_in_b: NDArray[np.floating]) -> Floats:
    """(..., 3) points in frame a, of points (..., 3) in frame b."""
    if T_a_b.ndim == 2:
        return points_in_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    return (T_a_b[..., :3, :3] @ points_in_b[..., None])[..., 0] + T_a_b[..., :3, 3]


def se2_to_se3(yaw: float, x: float, y: float, z: float = 0.0) -> Floats:
    """(4, 4) the motion of the plane as one of space."""
    return se2.to_se3(np.array([yaw, x, y]), z)


def level_at(T: Floats) -> Floats:
    """(4, 4) the frame with z up at the place and with the heading of a pose (4, 4)."""
    return se2_to_se3(float(np.arctan2(T[1, 0], T[0, 0])), *T[:3, 3])


def level_map(floor_in_map: Floats | None, height: float) -> Floats:
    """(4, 4) T_level_map: z up and the floor at z = 0; without a floor plane (4,) the sensor began upright, `height`
    above it."""
    T = np.eye(4)
    if floor_in_map is None:
        T[2, 3] = height
    else:
        T[:3, :3] = levelling(floor_in_map[:3])
        T[2, 3] = floor_in_map[3]
    return T


def raised(T_level_map: Floats, height: float) -> Floats:
    """(4, 4) the same with z counted from a plane that lies so much lower."""
    T = T_level_map.copy()
    T[2, 3] += height
    return T


def local_coordinates(T_a_b: Floats, T_a_c: Floats) -> Floats:
    """(6,) the pose (4, 4) of c as seen from b, in GTSAM's local coordinates: rotation first, then translation."""
    import gtsam

    return gtsam.Pose3(T_a_b).localCoordinates(gtsam.Pose3(T_a_c))
