"""Poses as 4 x 4 matrices and as `x y z qx qy qz qw`: the one home of this conversion."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def poses_to_xyzquat(poses: ArrayLike) -> NDArray[np.float64]:
    """(..., 4, 4) rigid transforms to (..., 7) `x y z qx qy qz qw`, with qw >= 0."""
    from scipy.spatial.transform import Rotation  # here, because it takes a third of a second

    matrices = np.asarray(poses, dtype=float)
    flat = matrices.reshape(-1, 4, 4)
    quaternions = np.empty((0, 4))
    if len(flat):
        quaternions = Rotation.from_matrix(flat[:, :3, :3]).as_quat(canonical=True)
    return np.concatenate([flat[:, :3, 3], quaternions], axis=1).reshape(*matrices.shape[:-2], 7)


def xyzquat_to_poses(xyzquat: ArrayLike) -> NDArray[np.float64]:
    """(..., 7) `x y z qx qy qz qw` to (..., 4, 4); the quaternions are normalised.

    Raises ValueError for a quaternion of zeros.
    """
    from scipy.spatial.transform import Rotation

    values = np.asarray(xyzquat, dtype=float)
    flat = values.reshape(-1, 7)
    poses = np.tile(np.eye(4), (len(flat), 1, 1))
    if len(flat):
        poses[:, :3, :3] = Rotation.from_quat(flat[:, 3:]).as_matrix()
    poses[:, :3, 3] = flat[:, :3]
    return poses.reshape(*values.shape[:-1], 4, 4)
