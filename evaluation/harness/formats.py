"""Trajectories in other systems' files: KITTI's and EuRoC's. TUM files are `Trajectory.read_tum` and `write_tum`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory import Trajectory
from data.trajectory.stamps import check_increasing, ns_to_seconds, read_times

Array = NDArray[np.float64]
SKEW = 1e-3  # of R R^T from the identity: what four decimals leave of a rotation
EUROC_HEADER = "#timestamp [ns], p_x [m], p_y [m], p_z [m], q_w [], q_x [], q_y [], q_z []"
_INT64 = np.iinfo(np.int64)


def read_kitti(path: Path | str, times: Path | str) -> Trajectory:
    """Reads KITTI poses: 12 numbers a line, the upper three rows of the pose, row by row.

    `times` is a file with one float second a line, a line for each pose. Rotations are made exact (the nearest
    rotation, since the files round). Raises UserError, with the line's number, for lines that are no pose, and
    where the times do not fit or do not increase.
    """
    poses, names = [], []
    for number, line in _lines(path, "KITTI poses"):
        values = _numbers(line.split(), path, number)
        if len(values) != 12:
            raise UserError(f"{path}, line {number}: {len(values)} values, 12 needed (a 3 x 4 matrix, row by row)")
        poses.append(_pose(np.reshape(values, (3, 4)), path, number))
        names.append(f"line {number}")
    stamps = read_times(Path(times))
    if len(stamps) != len(poses):
        raise UserError(f"{times}: {len(stamps)} times for the {len(poses)} poses of {path}; give one a pose")
    return _trajectory(stamps, np.array(poses), names, times)


def write_kitti(trajectory: Trajectory, path: Path | str, times: Path | str) -> None:
    """Writes poses, 12 numbers a line, and their times in seconds; each file atomically."""
    rows = trajectory.poses[:, :3].reshape(len(trajectory), 12).tolist()
    write_atomically(path, "".join(" ".join(f"{value:.17g}" for value in row) + "\n" for row in rows))
    write_atomically(times, "".join(ns_to_seconds(stamp) + "\n" for stamp in trajectory.stamps_ns.tolist()))


def read_euroc(path: Path | str) -> Trajectory:
    """Reads a EuRoC CSV: `ns, x, y, z, qw, qx, qy, qz` and maybe more (velocity, biases), which is passed over.

    Lines that begin with # are comments. Quaternions are normalised. Raises UserError, with the line's number, for
    lines that are no pose, lines of unequal length, and stamps that do not increase.
    """
    stamps, rows, names, columns = [], [], [], 0
    for number, line in _lines(path, "a EuRoC CSV"):
        fields = [field.strip() for field in line.split(",")]
        columns = columns or len(fields)
        if len(fields) < 8:
            raise UserError(f"{path}, line {number}: {len(fields)} values, 'ns,x,y,z,qw,qx,qy,qz' needed")
        if len(fields) != columns:
            raise UserError(f"{path}, line {number}: {len(fields)} values, where the lines before have {columns}")
        stamps.append(_nanoseconds(fields[0], path, number))
        x, y, z, qw, qx, qy, qz = _numbers(fields[1:8], path, number)
        if not 1e-6 < np.linalg.norm([qw, qx, qy, qz]) < 1e6:
            raise UserError(f"{path}, line {number}: the quaternion has no direction (all zero?)")
        rows.append([x, y, z, qx, qy, qz, qw])
        names.append(f"line {number}")
    return _trajectory(stamps, xyzquat_to_poses(rows), names, path)


def write_euroc(trajectory: Trajectory, path: Path | str) -> None:
    """Writes `ns,x,y,z,qw,qx,qy,qz` a line under a header, atomically."""
    lines = [EUROC_HEADER]
    for stamp, row in zip(trajectory.stamps_ns.tolist(), poses_to_xyzquat(trajectory.poses).tolist(), strict=True):
        x, y, z, qx, qy, qz, qw = (f"{value:.17g}" for value in row)
        lines.append(",".join([str(stamp), x, y, z, qw, qx, qy, qz]))
    write_atomically(path, "".join(line + "\n" for line in lines))


def _lines(path: Path | str, what: str) -> Iterator[tuple[int, str]]:
    """The lines that are neither blank nor comments, with their numbers."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give {what}") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: not a text file; give {what}") from None
    found = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            found = True
            yield number, line
    if not found:
        raise UserError(f"{path}: no poses in it; give {what}")


def _numbers(fields: list[str], path: Path | str, number: int) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError:
        raise UserError(f"{path}, line {number}: a value is not a number") from None
    if not np.isfinite(values).all():
        raise UserError(f"{path}, line {number}: a value is not finite")
    return values


def _nanoseconds(text: str, path: Path | str, number: int) -> int:
    try:
        stamp = int(text)
    except ValueError:
        raise UserError(f"{path}, line {number}: the stamp '{text}' is not whole nanoseconds") from None
    if not _INT64.min <= stamp <= _INT64.max:
        raise UserError(f"{path}, line {number}: the stamp '{text}' is too large for nanoseconds")
    return stamp


def _pose(rows: Array, path: Path | str, number: int) -> Array:
    R = rows[:, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > SKEW or np.linalg.det(R) < 0:
        raise UserError(f"{path}, line {number}: its 3 x 3 part is not a rotation")
    U, _, Vt = np.linalg.svd(R)
    return np.vstack([np.column_stack([U @ Vt, rows[:, 3]]), [0.0, 0.0, 0.0, 1.0]])


def _trajectory(stamps: list[int], poses: Array, names: list[str], where: Path | str) -> Trajectory:
    stamps_ns = np.array(stamps, dtype=np.int64)
    check_increasing(stamps_ns, str(where), names)
    return Trajectory(stamps_ns, poses)
