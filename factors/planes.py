"""Planes observed from poses. A plane is (nx, ny, nz, d) with n.x + d = 0 and a unit normal towards the observed side.

A plane variable is expressed in the frame of a nearby anchor pose (`LocalOrientedPlane3Factor`): in a distant frame, a
small error of the normal would be coupled with a large one of the offset.
"""

from typing import Any

import gtsam
import gtsam_unstable
import numpy as np
from numpy.typing import ArrayLike, NDArray


def observe_plane(
    plane_in_pose: ArrayLike, pose: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """Returns a factor for a plane (4,) observed in the frame of the pose variable `pose`.

    `pose` and `anchor` are the keys of the observing pose T_map_pose and of the pose T_map_anchor, in whose frame the
    plane variable `plane` is. Only the motion between both poses matters, so the factor does not depend on the map's
    origin. `noise` is three-dimensional, see `noise_of_plane`.

    Residual (3), in the frame of `pose`: difference of the normals in the tangent plane of the predicted one (rad),
    then of the offsets (m). The residual of the normal is 0 again at 180 degrees, so gate observations below 60
    degrees. Source: OrientedPlane3 of GTSAM (Trevor, Rogers, Christensen, ICRA 2012). Raises ValueError unless the
    plane is finite and its normal a unit vector.
    """
    return gtsam_unstable.LocalOrientedPlane3Factor(_checked(plane_in_pose), noise, pose, anchor, plane)


def observe_own_plane(plane_in_anchor: ArrayLike, identity: int, plane: int, noise: Any) -> gtsam.NoiseModelFactor:
    """Returns a factor for a plane (4,) as its own anchor observed it: a prior on the plane variable.

    `identity` is the key of a pose variable that a tight prior holds at the identity (GTSAM wraps no prior for planes);
    robust noise is not supported. The rest is as of `observe_plane`, in the anchor's frame.
    """
    return gtsam.OrientedPlane3Factor(_checked(plane_in_anchor), noise, identity, plane)


def plane_from_wall(normal: ArrayLike, point: ArrayLike) -> NDArray[np.float64]:
    """Returns (4,) the vertical plane through `point` (2,), in metres, with the horizontal unit `normal` (2,)."""
    n, p = np.asarray(normal, dtype=float), np.asarray(point, dtype=float)
    return np.array([n[0], n[1], 0.0, -float(n @ p)])


def _checked(plane: ArrayLike) -> NDArray[np.float64]:
    value = np.asarray(plane, dtype=float)
    if value.shape != (4,) or not np.all(np.isfinite(value)) or abs(np.linalg.norm(value[:3]) - 1) > 1e-6:
        raise ValueError(f"a plane must be four finite numbers with a unit normal, not {value}")
    return value
