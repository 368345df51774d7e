"""Poses in the forms of other programs: TUM, KITTI's poses, EuRoC's CSV."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import text_lines, write_atomically
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory.stamps import ns_to_seconds, read_times
from data.trajectory.trajectory import Trajectory

_KITTI, _EUROC = 12, 8  # numbers of a line; EuRoC's may be followed by speeds and biases
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
    line = _first_line(path)
    if "," in line:
        poses = PoseList.of(read_euroc(path))
    elif len(line.split()) == _KITTI:
        return _stamped(path, read_kitti(path), times)
    else:
        poses = PoseList.of(Trajectory.read_tum(path))
    if times is not None:
        raise UserError(f"{times}: {path} has stamps of its own; leave out the times")
    return poses


def read_kitti(path: Path | str) -> NDArray[np.float64]:
    """(N, 4, 4) the poses of a file with the upper 3 x 4 of each, row by row. Raises UserError, naming the line."""
    poses = []
    for number, text in _lines(Path(path)):
        row = _numbers(f"{path}, line {number}", text.split(), _KITTI, "the upper 3 x 4 of a pose")
        try:
            poses.append(squared(np.vstack([row.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])))
        except ValueError as error:
            raise UserError(f"{path}, line {number}: {error}") from None
    if not poses:
        raise UserError(f"{path}: no poses in it; give lines of 12 numbers")
    return np.stack(poses)


def read_euroc(path: Path | str) -> Trajectory:
    """Reads EuRoC's ground truth: stamp in ns, position, quaternion with w first; what follows is not used.

    Raises UserError, naming the line, for a line that is not so and stamps that do not increase.
    """
    stamps, rows = list[int](), list[NDArray[np.float64]]()
    for number, text in _lines(Path(path)):
        where, words = f"{path}, line {number}", [word.strip() for word in text.split(",")]
        row = _numbers(where, words[1:_EUROC], _EUROC - 1, "'stamp_ns, x, y, z, qw, qx, qy, qz'")
        if not words[0].lstrip("-").isdecimal():
            raise UserError(f"{where}: '{words[0]}' is not a stamp in whole nanoseconds")
        stamp = int(words[0])
        if abs(stamp) > np.iinfo(np.int64).max or (stamps and stamp <= stamps[-1]):
            raise UserError(f"{where}: the stamp does not increase; sort by time, one pose per stamp")
        if np.linalg.norm(row[3:]) < 1e-6:
            raise UserError(f"{where}: the quaternion has no direction (all zero?)")
        stamps.append(stamp)
        rows.append(row[[0, 1, 2, 4, 5, 6, 3]])
    if not rows:
        raise UserError(f"{path}: no poses in it; give lines of 'stamp_ns, x, y, z, qw, qx, qy, qz'")
    return Trajectory(np.array(stamps, np.int64), xyzquat_to_poses(np.stack(rows)))


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


def _first_line(path: Path) -> str:
    """The first line of a file that holds something; empty if there is none."""
    return next((text for _, text in _lines(path)), "")


def _lines(path: Path) -> list[tuple[int, str]]:
    """Number and text of each line, without comments and blank lines. Raises UserError."""
    lines = text_lines(path, "a file of poses")
    kept = ((number, line.partition("#")[0].strip()) for number, line in enumerate(lines, 1))
    return [(number, text) for number, text in kept if text]


def _numbers(where: str, words: list[str], count: int, form: str) -> NDArray[np.float64]:
    """(count,) finite numbers. Raises UserError."""
    if len(words) != count:
        raise UserError(f"{where}: {len(words)} values, {form} needed")
    try:
        row = np.array([float(word) for word in words])
    except ValueError:
        raise UserError(f"{where}: a value is not a number") from None
    if not np.isfinite(row).all():
        raise UserError(f"{where}: a value is not finite")
    return row


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
