"""KISS-SLAM's folder of results (github.com/PRBonn/kiss-slam, 0.0.2): a pose for each scan, and local maps.

Its factor graphs (`trajectory.g2o`, `local_map_graph.g2o`) weight all edges alike: they tell nothing of how uncertain a
pose is, and are not read.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.formats import read_points
from data.scans.reading_errors import UnreadableScanError
from data.slam_output.map_scans import MapPiece, MapScans
from data.slam_output.posed_scans import walking_stamps
from data.trajectory import Trajectory
from data.trajectory.readers import PoseList, read_kitti, squared
from data.trajectory.stamps import seconds_to_ns

_MAPS = Path("local_maps") / "plys"  # in the frame of the poses


def find_kiss_slam(folder: Path) -> Path | None:
    """The folder of KISS-SLAM's or KISS-ICP's results: this one, or `latest` in it; None if neither is one."""
    return next((f for f in (folder, folder / "latest") if f.is_dir() and any(f.glob("*_poses_kitti.txt"))), None)


def read_kiss_poses(folder: Path) -> PoseList:
    """The poses T_map_sensor at the ends of all scans. Where the data had no stamps, they are 0, 1, 2, ... s.

    Raises UserError.
    """
    texts = sorted(folder.glob("*_poses_kitti.txt"))
    if len(texts) != 1:
        raise UserError(f"{folder}: {len(texts)} files *_poses_kitti.txt; give a folder with the results of one run")
    stem = texts[0].name.removesuffix("_kitti.txt")
    exact = folder / f"{stem}.npy"
    poses = _read_npy(exact) if exact.is_file() else read_kitti(texts[0])
    return PoseList(poses, _stamps(folder / f"{stem}_tum.txt", len(poses)), at_ends=True)


def kiss_slam_scans(folder: Path) -> MapScans:
    """The points of the local maps as the poses saw them. Raises UserError if there are no local maps."""
    poses = read_kiss_poses(folder)
    stamps = walking_stamps(poses.poses) if poses.stamps_ns is None else poses.stamps_ns
    clouds = [_read_map(path) for path in sorted((folder / _MAPS).glob("*.ply"))]
    if not clouds:
        raise UserError(f"{folder}: no local maps ({_MAPS}/*.ply) in it; give its scans with --scans")
    everyone = np.arange(len(stamps))
    scans = MapScans(folder, Trajectory(stamps, poses.poses), [MapPiece(np.concatenate(clouds), everyone)])
    if poses.stamps_ns is None:
        scans.note = "the poses have no stamps; a sensor speed of 1 m/s is assumed"
    return scans


def _read_map(path: Path) -> NDArray[np.float64]:
    try:
        return np.asarray(read_points(path), np.float64)
    except UnreadableScanError as error:
        raise UserError(f"{path}: {error}") from None


def _read_npy(path: Path) -> NDArray[np.float64]:
    try:
        poses = np.asarray(np.load(path, allow_pickle=False), np.float64)
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
        raise UserError(f"{path}: an array of shape {poses.shape}; poses (N, 4, 4) needed")
    try:
        return np.stack([squared(pose) for pose in poses])
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None


def _stamps(path: Path, count: int) -> NDArray[np.int64] | None:
    """(count,) the stamps in the first column of a file; None where there are none."""
    if not path.is_file():
        return None
    try:
        stamps = [seconds_to_ns(line.split()[0]) for line in path.read_text().splitlines() if line.strip()]
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: no stamps in seconds in its first column ({error})") from None
    found = np.array(stamps, np.int64)
    return None if len(found) != count or np.any(found[1:] <= found[:-1]) else found
