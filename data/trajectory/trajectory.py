"""A trajectory: stamped poses; its files, in the forms of TUM and of KITTI's poses."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import parsed_lines, write_atomically
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory.stamps import ns_to_seconds, read_times, seconds_to_ns

_TUM, _KITTI = 8, 12  # numbers of a line
_SKEW = 1e-3  # by which a rotation may be off: files are written with few digits


@dataclass(frozen=True, eq=False)
class Trajectory:
    """`stamps_ns` (N,) int64, strictly increasing; `poses` (N, 4, 4): each maps sensor coordinates to the
    trajectory's frame (metres). Both are read-only copies.
    """

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Raises ValueError for shapes that do not fit, stamps that do not increase, and improper poses."""
        stamps, poses = np.array(self.stamps_ns), np.array(self.poses, dtype=np.float64)
        if stamps.size == 0:
            stamps, poses = np.empty(0, np.int64), poses.reshape(0, 4, 4)
        if stamps.ndim != 1 or stamps.dtype.kind not in "iu" or poses.shape != (len(stamps), 4, 4):
            kind = f"{stamps.dtype} stamps of shape {stamps.shape}"
            raise ValueError(f"trajectory: {kind} with poses of shape {poses.shape}")
        stamps = stamps.astype(np.int64)
        if np.any(stamps[1:] <= stamps[:-1]):
            raise ValueError("trajectory: the stamps do not increase strictly")
        if not np.isfinite(poses).all():
            raise ValueError("trajectory: a pose is not finite")
        rotations = poses[:, :3, :3]
        skew = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
        if skew > 1e-5 or np.any(np.linalg.det(rotations) < 0) or np.any(poses[:, 3] != [0, 0, 0, 1]):
            raise ValueError("trajectory: a pose is not a rigid transform")
        for name, array in (("stamps_ns", stamps), ("poses", poses)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        """The number of poses."""
        return len(self.stamps_ns)

    @property
    def positions(self) -> NDArray[np.float64]:
        """(N, 3) the sensor's positions in the trajectory's frame."""
        return self.poses[:, :3, 3]

    @property
    def length(self) -> float:
        """The length (m) of the way."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    def transformed(self, T_new_old: NDArray[np.float64]) -> "Trajectory":
        """Returns the same motion in another frame; `T_new_old` is (4, 4)."""
        return Trajectory(self.stamps_ns, T_new_old @ self.poses)

    def only(self, chosen: NDArray[np.bool_]) -> "Trajectory":
        """Returns the poses where `chosen` (N,) is true."""
        return Trajectory(self.stamps_ns[chosen], self.poses[chosen])

    def between(self, other: "Trajectory") -> "Trajectory":
        """Returns the poses from the first to the last stamp of `other`; empty if `other` is."""
        first, last = (other.stamps_ns[0], other.stamps_ns[-1]) if len(other) else (0, -1)
        return self.only((self.stamps_ns >= first) & (self.stamps_ns <= last))

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns (M, 4, 4) the poses at other stamps (M,) int64, by linear interpolation of position and rotation.

        Before the first and after the last pose, it extrapolates from the two nearest. Raises ValueError for fewer than
        two poses.
        """
        from scipy.spatial.transform import Rotation  # here, because it takes a third of a second

        if len(self) < 2:
            raise ValueError(f"trajectory: {len(self)} poses; interpolation needs two")
        after = np.clip(np.searchsorted(self.stamps_ns, stamps_ns), 1, len(self) - 1)
        first, second = self.poses[after - 1], self.poses[after]
        span = self.stamps_ns[after] - self.stamps_ns[after - 1]
        share = (np.asarray(stamps_ns) - self.stamps_ns[after - 1]) / span
        turn = Rotation.from_matrix(first[:, :3, :3].transpose(0, 2, 1) @ second[:, :3, :3]).as_rotvec()
        poses = first.copy()
        poses[:, :3, :3] = first[:, :3, :3] @ Rotation.from_rotvec(share[:, None] * turn).as_matrix()
        poses[:, :3, 3] += share[:, None] * (second[:, :3, 3] - first[:, :3, 3])
        poses[share == 0], poses[share == 1] = first[share == 0], second[share == 1]
        return poses

    def write_tum(self, path: Path | str) -> None:
        """Writes lines `t x y z qx qy qz qw`, atomically; stamps (s) are exact to the nanosecond."""
        lines = [
            " ".join([ns_to_seconds(stamp), *(f"{value:.15g}" for value in row)])
            for stamp, row in zip(self.stamps_ns.tolist(), poses_to_xyzquat(self.poses).tolist(), strict=True)
        ]
        write_atomically(path, "".join(line + "\n" for line in lines))

    @staticmethod
    def read_tum(path: Path | str) -> "Trajectory":
        """Reads a TUM file; comments (#) and blank lines are skipped, quaternions normalised.

        Raises UserError, with the line's number, if the file is not a trajectory with increasing stamps.
        """
        stamps = list[int]()

        def row_of(text: str) -> NDArray[np.float64]:
            words = text.split()
            if len(words) != _TUM:
                raise ValueError(f"{len(words)} values")
            stamp, row = seconds_to_ns(words[0]), numbers_in(words[1:], _TUM - 1)
            if not 1e-6 < np.linalg.norm(row[3:]) < 1e6:
                raise ValueError("the quaternion has no direction (all zero?)")
            if stamps and stamp <= stamps[-1]:
                raise ValueError(f"the stamp {'repeats' if stamp == stamps[-1] else 'goes backwards'}; sort by time")
            stamps.append(stamp)
            return row

        rows = parsed_lines(path, "a trajectory, lines of 't x y z qx qy qz qw'", row_of)
        return Trajectory(np.array(stamps, dtype=np.int64), xyzquat_to_poses(rows))


def numbers_in(words: Sequence[str], count: int) -> NDArray[np.float64]:
    """(count,) finite numbers. Raises ValueError."""
    if len(words) != count:
        raise ValueError(f"{len(words)} values")
    try:
        row = np.array([float(word) for word in words])
    except ValueError:
        raise ValueError("a value is not a number") from None
    if not np.isfinite(row).all():
        raise ValueError("a value is not finite")
    return row


def moved_with(given: Trajectory, corrected: Trajectory) -> Trajectory:
    """All poses of `given` in the frame of `corrected`, which holds some of them, corrected.

    Between two corrected poses the correction is interpolated over time; before the first and after the last it is
    theirs. Raises ValueError where `corrected` is empty.
    """
    if not len(corrected):
        raise ValueError("trajectory: no corrected pose")
    if len(given) < 2:
        return Trajectory(corrected.stamps_ns, corrected.poses)
    corrections = corrected.poses @ np.linalg.inv(given.at(corrected.stamps_ns))
    if len(corrected) == 1:
        return given.transformed(corrections[0])
    # about the middle of the way: far from zero, a turn that is interpolated would move the poses
    middle = np.eye(4)
    middle[:3, 3] = given.positions.mean(axis=0)
    local = Trajectory(corrected.stamps_ns, np.linalg.inv(corrections[0] @ middle) @ corrections @ middle)
    stamps = np.clip(given.stamps_ns, corrected.stamps_ns[0], corrected.stamps_ns[-1])
    return Trajectory(given.stamps_ns, corrections[0] @ middle @ local.at(stamps) @ np.linalg.inv(middle) @ given.poses)


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


def read_poses(path: Path | str, times: Path | str | None = None) -> PoseList:
    """Reads a file of poses; by its content it is TUM (8 numbers a line) or KITTI's (12).

    `times` is a file with one float second a line, for KITTI's poses, which have no stamps. Raises UserError, with the
    line's number, for anything else.
    """
    path = Path(path)
    line = parsed_lines(path, "a file of poses", str)[0]
    if "," in line:
        raise UserError(f"{path}: EuRoC's form is no longer read; give what 'evo_traj euroc FILE --save_as_tum' writes")
    if len(line.split()) == _KITTI:
        return _stamped(path, read_kitti(path), times)
    trajectory = Trajectory.read_tum(path)
    if times is not None:
        raise UserError(f"{times}: {path} has stamps of its own; leave out the times")
    return PoseList(np.array(trajectory.poses), np.array(trajectory.stamps_ns))


def read_kitti(path: Path | str) -> NDArray[np.float64]:
    """(N, 4, 4) the poses of a file with the upper 3 x 4 of each, row by row. Raises UserError, naming the line."""

    def pose(text: str) -> NDArray[np.float64]:
        return squared(np.vstack([numbers_in(text.split(), _KITTI).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]))

    return np.stack(parsed_lines(path, "lines of 12 numbers, the upper 3 x 4 of a pose", pose))


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
