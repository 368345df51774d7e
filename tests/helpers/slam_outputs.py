"""What another SLAM system would leave behind of the drive through the small building, in the forms of several."""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from boxes import Array, pose
from drives import small_drive

from data.geometry.poses import poses_to_xyzquat
from data.scans.writers import write_ply
from data.trajectory import Trajectory
from data.trajectory.trajectory import write_kitti

EVERY = 5  # of the drive's scans, those that are keyframes: a second apart
_VOXEL = 0.05  # m, of maps


@dataclass(frozen=True)
class SlamOutput:
    """`poses` are T_map_sensor of all scans, off from the truth as drift makes them; `clouds` (N, 3) of the keyframes
    in the sensor frame, `keyframes` their poses."""

    poses: Trajectory
    keyframes: Trajectory
    clouds: list[Array]

    def map(self, first: int = 0, last: int | None = None) -> Array:
        """(N, 3) the points of some keyframes in the map frame, one a voxel."""
        chosen = zip(self.clouds[first:last], self.keyframes.poses[first:last], strict=True)
        points = np.concatenate([cloud @ T[:3, :3].T + T[:3, 3] for cloud, T in chosen])
        _, kept = np.unique(np.floor(points / _VOXEL).astype(int), axis=0, return_index=True)
        return np.asarray(points[kept])

    def write_clouds(self, folder: Path) -> Path:
        """One file a keyframe, without stamps."""
        folder.mkdir()
        for k, cloud in enumerate(self.clouds):
            np.save(folder / f"{k:06d}.npy", cloud)
        return folder

    def write_kiss_slam(self, folder: Path) -> Path:
        """As KISS-SLAM 0.0.2 does, of the keyframes alone; the local maps are in the frame of the poses."""
        (folder / "local_maps/plys").mkdir(parents=True)
        np.save(folder / "drive_poses.npy", self.keyframes.poses)
        write_kitti(self.keyframes, folder / "drive_poses_kitti.txt", folder / "times")
        (folder / "times").unlink()
        rows = np.column_stack([self.keyframes.stamps_ns / 1e9, poses_to_xyzquat(self.keyframes.poses)])
        np.savetxt(folder / "drive_poses_tum.txt", rows, fmt="%.4f")
        for k, first in enumerate(range(0, len(self.clouds), 20)):
            write_ply(folder / f"local_maps/plys/{k:06d}.ply", self.map(first, first + 20))
        return folder

    def write_g2o(self, path: Path, sigma: float = 0.02, angle: float = 0.01) -> Path:
        """A graph of the keyframes alone, held at the first, with the motion from each to the next, which is known to
        `sigma` (m) and `angle` (rad)."""
        a, b = f"{sigma**-2:g}", f"{(angle / 2) ** -2:g}"
        information = f"{a} 0 0 0 0 0 {a} 0 0 0 0 {a} 0 0 0 {b} 0 0 {b} 0 {b}"
        poses = self.keyframes.poses
        lines = [f"VERTEX_SE3:QUAT {k} {_words(poses_to_xyzquat(T))}" for k, T in enumerate(poses)]
        steps = np.linalg.inv(poses[:-1]) @ poses[1:]
        lines += [f"EDGE_SE3:QUAT {k} {k + 1} {_words(poses_to_xyzquat(T))} {information}" for k, T in enumerate(steps)]
        path.write_text("\n".join([lines[0], "FIX 0", *lines[1:]]) + "\n")
        return path


@functools.cache
def slam_output(bend: float = 0.00005, slip: float = 0.0005) -> SlamOutput:
    """The drive as odometry sees it that turns by `bend` (rad) a scan too far and errs by `slip` (m) at random."""
    drive, rng = small_drive(), np.random.default_rng(0)
    poses = [np.eye(4)]
    for before, after in zip(drive.truth.poses[:-1], drive.truth.poses[1:], strict=True):
        off = rng.normal(0.0, slip, 3)
        poses.append(poses[-1] @ np.linalg.inv(before) @ after @ pose(off[0], off[1], 0.2 * off[2], bend))
    trajectory = Trajectory(drive.truth.stamps_ns, np.array(poses))
    chosen = np.arange(len(trajectory)) % EVERY == 0
    return SlamOutput(trajectory, trajectory.only(chosen), [points for _, points in drive.scans[::EVERY]])


def write_poses(trajectory: Trajectory, folder: Path, form: str) -> list[Path | str]:
    """Writes poses as `tum` or `kitti`; returns the arguments that name them to the command."""
    path = folder / f"poses.{form}"
    if form == "kitti":
        write_kitti(trajectory, path, folder / "times.txt")
        return [path, "--times", folder / "times.txt"]
    trajectory.write_tum(path)
    return [path]


def _words(values: Array) -> str:
    return " ".join(f"{value:.9g}" for value in np.asarray(values).tolist())
