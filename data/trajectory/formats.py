"""Trajectories in the forms of KITTI's and EuRoC's ground truth, which evaluation tools read."""

from pathlib import Path

from data.common.files import write_atomically
from data.geometry.poses import poses_to_xyzquat
from data.trajectory.stamps import ns_to_seconds
from data.trajectory.trajectory import Trajectory

_EUROC = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"  # S is the sensor
)


def write_kitti(trajectory: Trajectory, poses: Path, times: Path) -> None:
    """KITTI's odometry form: in `poses` the upper 3 x 4 of each pose row by row, in `times` its seconds. The sensor's
    axes are the trajectory's own, not those of KITTI's camera. Both are written atomically."""
    rows = trajectory.poses[:, :3].reshape(-1, 12).tolist()
    write_atomically(poses, "".join(" ".join(f"{value:.15g}" for value in row) + "\n" for row in rows))
    write_atomically(times, "".join(f"{ns_to_seconds(stamp)}\n" for stamp in trajectory.stamps_ns.tolist()))


def write_euroc(trajectory: Trajectory, path: Path) -> None:
    """The form of EuRoC's ground truth without speeds and biases: nanoseconds, position, quaternion with w first;
    atomically."""
    lines = [_EUROC]
    quaternions = poses_to_xyzquat(trajectory.poses).tolist()
    for stamp, (x, y, z, qx, qy, qz, qw) in zip(trajectory.stamps_ns.tolist(), quaternions, strict=True):
        lines.append(",".join([str(stamp), *(f"{value:.15g}" for value in (x, y, z, qw, qx, qy, qz))]))
    write_atomically(path, "\n".join(lines) + "\n")
