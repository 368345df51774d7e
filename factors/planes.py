"""Planes seen from poses. A plane is (nx, ny, nz, d) with n.x + d = 0, a unit normal to the side seen.

A plane variable is kept in the frame of an anchor pose near it (`LocalOrientedPlane3Factor`), because the
offset of a plane far from its frame's origin is coupled with its normal by the lever arm.
"""

import gtsam
import gtsam_unstable
import numpy as np
from numpy.typing import ArrayLike, NDArray


def observe_plane(
    plane_in_pose: ArrayLike, pose: int, anchor: int, plane: int, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """A plane (4,) seen in the frame of pose variable `pose`; the plane's variable lives in `anchor`'s frame.

    Variables: the poses `pose` T_map_pose and `anchor` T_map_anchor, and `plane` in the anchor's frame; only the motion
    between the two poses counts, so that it does not matter where the map begins. Residual (3), in the frame of `pose`:
    the difference of the normals in the tangent plane of the predicted one (rad), and of the offsets (m). Source:
    OrientedPlane3 of GTSAM (Trevor, Rogers, Christensen, ICRA 2012). The normal's residual is 0 again at 180 degrees:
    gate below 60 degrees before adding. Raises ValueError for a plane that is not finite or whose normal is not a unit
    vector.
    """
    return gtsam_unstable.LocalOrientedPlane3Factor(_checked(plane_in_pose), noise, pose, anchor, plane)


def observe_own_plane(
    plane_in_anchor: ArrayLike, identity: int, plane: int, noise: gtsam.noiseModel.Gaussian
) -> gtsam.NoiseModelFactor:
    """The plane (4,) as its own anchor saw it: a prior on the plane variable.

    Variables: `plane` in the anchor's frame, and `identity`, a pose that a tight prior holds at the identity (GTSAM
    wraps no prior for planes). Takes Gaussian noise only. Residual (3) as in `observe_plane`, in the anchor's frame.
    Source: as there. Raises ValueError as it does.
    """
    return gtsam.OrientedPlane3Factor(_checked(plane_in_anchor), noise, identity, plane)


def plane_from_wall(normal: ArrayLike, point: ArrayLike) -> NDArray[np.float64]:
    """(4,) the upright plane through `point` (2,) with the horizontal unit `normal` (2,)."""
    n, p = np.asarray(normal, dtype=float), np.asarray(point, dtype=float)
    return np.array([n[0], n[1], 0.0, -float(n @ p)])


def _checked(plane: ArrayLike) -> NDArray[np.float64]:
    value = np.asarray(plane, dtype=float)
    if value.shape != (4,) or not np.all(np.isfinite(value)) or abs(np.linalg.norm(value[:3]) - 1) > 1e-6:
        raise ValueError(f"a plane is four finite numbers with a unit normal, not {value}")
    return value
