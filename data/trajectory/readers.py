"""Poses in the forms of other programs: TUM, KITTI's poses, EuRoC's CSV."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import parsed_lines, write_atomically
from data.geometry.poses import poses_to_xyzquat
from data.trajectory.stamps import ns_to_seconds, read_times
from data.trajectory.trajectory import Trajectory, numbers_in, trajectory_in

_KITTI, _EUROC = 12, 8  # numbers of a line; EuRoC's may be followed by speeds and biases
_EUROC_FORM = "'stamp_ns, x, y, z, qw, qx, qy, qz'"
_SKEW = 1e-3  # by which a rotation may be off: files are written with few digits
_EUROC_HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"  # S is the sensor
)


@dataclass(frozen=True, eq=False)
class PoseList:
    """Poses T_odom_sensor (N, 4, 4) in order, and their stamps (N,) in ns; None where the file has none.

    `step_covariances` (N) are those of the motion from the pose before: (6, 6), rotation (rad) first, in the axes of
    the pose; None where the file does not say. `at_ends`: the stamps are those of scans, at whose ends the poses hold.
    """

    poses: NDArray[np.float64]
    stamps_ns: NDArray[np.int64] | None
    step_covariances: Sequence[NDArray[np.float64] | None] | None = None
    at_ends: bool = False

    @staticmethod
    def of(trajectory: Trajectory) -> "PoseList":
        """The poses and stamps of a trajectory."""
        return PoseList(np.array(trajectory.poses), np.array(trajectory.stamps_ns))


def read_poses(path: Path | str, times: Path | str | None = None) -> PoseList:
    """Reads a file of poses; by its content it is TUM (8 numbers a line), KITTI's (12) or EuRoC's CSV.

    `times` is a file with one float second a line, for KITTI's poses, which have no stamps. Raises UserError, with the
    line's number, for anything else.
    """
    path = Path(path)
    line = parsed_lines(path, "a file of poses", str)[0]
    if "," in line:
        poses = PoseList.of(trajectory_in(path, _EUROC_FORM, _euroc))
    elif len(line.split()) == _KITTI:
        return _stamped(path, read_kitti(path), times)
    else:
        poses = PoseList.of(Trajectory.read_tum(path))
    if times is not None:
        raise UserError(f"{times}: {path} has stamps of its own; leave out the times")
    return poses


def read_kitti(path: Path | str) -> NDArray[np.float64]:
    """(N, 4, 4) the poses of a file with the upper 3 x 4 of each, row by row. Raises UserError, naming the line."""

    def pose(text: str) -> NDArray[np.float64]:
        return squared(np.vstack([numbers_in(text.split(), _KITTI).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]))

    return np.stack(parsed_lines(path, "lines of 12 numbers, the upper 3 x 4 of a pose", pose))


def _euroc(text: str) -> tuple[int, NDArray[np.float64]]:
    """A line of EuRoC's ground truth: stamp in ns, position, quaternion with w first; what follows is not used."""
    stamp, *words = (word.strip() for word in text.split(","))
    row = numbers_in(words[: _EUROC - 1], _EUROC - 1)
    if not stamp.lstrip("-").isdecimal() or abs(int(stamp)) > np.iinfo(np.int64).max:
        raise ValueError(f"'{stamp}' is not a stamp in whole nanoseconds")
    return int(stamp), row[[0, 1, 2, 4, 5, 6, 3]]


def squared(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose (4, 4) with the rotation that is nearest to its own. Raises ValueError for one that is not rigid."""
    if not np.isfinite(pose).all():
        raise ValueError("a number is not finite")
    R = pose[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > _SKEW or np.linalg.det(R) < 0:
        raise ValueError("a pose is not a rigid transform")
    left, _, right = np.linalg.svd(R)
    found = pose.copy()
    found[:3, :3] = left @ right
    return found


def _stamped(path: Path, poses: NDArray[np.float64], times: Path | str | None) -> PoseList:
    if times is None:
        return PoseList(poses, None)
    stamps = np.array(read_times(Path(times)), np.int64)
    if len(stamps) != len(poses):
        raise UserError(f"{times}: {len(stamps)} stamps for the {len(poses)} poses in {path}; give one per pose")
    if np.any(stamps[1:] <= stamps[:-1]):
        raise UserError(f"{times}: the stamps do not increase; sort by time, one pose per stamp")
    return PoseList(poses, stamps)


def write_kitti(trajectory: Trajectory, poses: Path, times: Path) -> None:
    """KITTI's odometry form: in `poses` the upper 3 x 4 of each pose row by row, in `times` its seconds. The sensor's
    axes are the trajectory's own, not those of KITTI's camera. Both are written atomically."""
    rows = trajectory.poses[:, :3].reshape(-1, 12).tolist()
    write_atomically(poses, "".join(" ".join(f"{value:.15g}" for value in row) + "\n" for row in rows))
    write_atomically(times, "".join(f"{ns_to_seconds(stamp)}\n" for stamp in trajectory.stamps_ns.tolist()))


def write_euroc(trajectory: Trajectory, path: Path) -> None:
    """The form of EuRoC's ground truth without speeds and biases: nanoseconds, position, quaternion with w first;
    atomically."""
    lines = [_EUROC_HEADER]
    quaternions = poses_to_xyzquat(trajectory.poses).tolist()
    for stamp, (x, y, z, qx, qy, qz, qw) in zip(trajectory.stamps_ns.tolist(), quaternions, strict=True):
        lines.append(",".join([str(stamp), *(f"{value:.15g}" for value in (x, y, z, qw, qx, qy, qz))]))
    write_atomically(path, "\n".join(lines) + "\n")
