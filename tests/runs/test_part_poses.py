"""Where the scans of a part of the map that was not placed lie in the map's trajectory."""

import numpy as np
from boxes import Array
from scipy.spatial.transform import Rotation

from data.trajectory import Trajectory
from sgslam.session.scan_poses import ScanPose, with_unplaced


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
