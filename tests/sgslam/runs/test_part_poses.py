"""Where the scans of a part of the map that was not placed lie in the map's trajectory, and parts in another order
than their stamps."""

from dataclasses import replace

import numpy as np
from boxes import Array
from drives import fed, small_drive
from scipy.spatial.transform import Rotation

from data.trajectory import Trajectory
from sgslam.backend import Backend
from sgslam.config import Config
from sgslam.session.scan_poses import ScanPose, with_unplaced
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty, scan_uncertainty
from sgslam.slam import SceneGraphSlam


def pose(x: float, y: float, z: float, roll: float, yaw: float) -> Array:
    """(4, 4), from metres and degrees."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("ZX", [yaw, roll], degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


def test_a_part_begins_level_at_the_last_known_place_and_heading() -> None:
    known = Trajectory(np.array([0, 10]), np.stack([np.eye(4), pose(5.0, 2.0, 1.0, roll=20.0, yaw=90.0)]))
    first, second = pose(0.0, 0.0, 0.0, roll=-10.0, yaw=0.0), pose(3.0, 0.0, 0.0, roll=0.0, yaw=30.0)
    scans = [
        ScanPose(20, first, first, 0, np.eye(4)),
        ScanPose(30, second, second, 1, np.eye(4), T_previous_sensor=np.linalg.inv(first) @ second),
    ]
    whole = with_unplaced(known, [(scans, np.stack([first, second]))])
    assert whole.stamps_ns.tolist() == [0, 10, 20, 30]
    np.testing.assert_allclose(whole.poses[2], pose(5.0, 2.0, 1.0, roll=-10.0, yaw=90.0), atol=1e-9)
    np.testing.assert_allclose(whole.poses[3], pose(5.0, 5.0, 1.0, roll=0.0, yaw=120.0), atol=1e-9)


def test_parts_that_joined_out_of_their_order_are_in_that_of_their_stamps() -> None:
    """As where an earlier part of a run joins the map of a later one."""
    slam = fed(SceneGraphSlam(), small_drive().scans[:60])
    slam.finish()
    scans, backend = slam._map.scans, slam._map.backend
    known, second = backend.uncertainty(), backend.keyframes[len(backend.keyframes) // 2]

    def told() -> ScanUncertainty:
        return scan_uncertainty(scans, slice(None), backend, known, np.eye(3), Config(), 0, placed=True)

    before, stamps = told(), [scan.stamp_ns for scan in scans]
    earlier = 10**12  # ns, of the second half, which stays behind the first one in the map
    for scan in scans[second.scan :]:
        scan.stamp_ns -= earlier
    for k, keyframe in enumerate(backend.keyframes):
        if keyframe.scan >= second.scan:
            backend.keyframes[k] = replace(keyframe, stamp_ns=keyframe.stamp_ns - earlier)
    after = told()
    assert np.all(np.diff(after.stamps_ns) > 0)
    order = [*range(second.scan, len(scans)), *range(second.scan)]
    assert after.stamps_ns.tolist() == [scans[i].stamp_ns for i in order]
    inside = [n for n, i in enumerate(order) if i >= second.scan or stamps[i] <= before_of(backend, second.scan)]
    assert len(inside) > 50
    np.testing.assert_allclose(after.sigma[inside], before.sigma[order][inside], rtol=1e-6)


def before_of(backend: Backend, scan: int) -> int:
    """The stamp of the last keyframe before a scan: after it, a pose also depends on the next one."""
    return max(keyframe.stamp_ns for keyframe in backend.keyframes if keyframe.scan < scan)
