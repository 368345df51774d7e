"""Opens the output of another SLAM system as scans with poses."""

from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.scans.formats import READERS, read_points
from data.scans.point_times import Stamped
from data.scans.reading_errors import UnreadableScanError
from data.scans.scan import ScanSource
from data.scans.sources import open_scans
from data.slam_output.glim import glim_scans, is_glim, read_glim_poses
from data.slam_output.graph_poses import read_graph_poses
from data.slam_output.kiss_slam import find_kiss_slam, kiss_slam_scans, read_kiss_poses
from data.slam_output.map_scans import MapPiece, MapScans
from data.slam_output.posed_scans import PosedScans, walking_stamps
from data.trajectory import Trajectory
from data.trajectory.readers import PoseList, read_poses


def open_slam_output(
    path: Path, scans: Path | None = None, topic: str | None = None, cloud: Path | None = None,
    times: Path | None = None, stamped: Stamped = "auto",
) -> ScanSource:  # fmt: skip
    """Opens a file of poses (a factor graph as `.g2o` is one too), KISS-SLAM's folder or GLIM's dump.

    `scans` are those that the system saw, or a cloud for each pose, of a bag those of a `topic`; `cloud` is its map, in
    the frame of the poses. KISS-SLAM's and GLIM's own maps need neither. `times` has the stamps of KITTI's poses;
    `stamped` is that of `open_scans`. Raises UserError.
    """
    if scans is not None and cloud is not None:
        raise UserError("--scans and --cloud: give only one of them")
    if times is not None and path.is_dir():
        raise UserError(f"{times}: only files of poses need --times; leave it out")
    if scans is not None:
        return PosedScans(open_scans(scans, topic, stamped), _poses(path, times), str(path))
    if cloud is not None:
        return _map_scans(path, cloud, times)
    if path.is_dir() and (folder := find_kiss_slam(path)) is not None:
        return kiss_slam_scans(folder)
    if path.is_dir() and is_glim(path):
        return glim_scans(path)
    if path.is_dir():
        raise UserError(f"{path}: neither KISS-SLAM's folder of results nor GLIM's dump; give a file of poses")
    raise UserError(f"{path}: poses alone are not enough; give --scans (a folder or a bag) or --cloud (a map)")


def _poses(path: Path, times: Path | None) -> PoseList:
    if path.suffix.lower() == ".g2o":
        return read_graph_poses(path)
    if not path.is_dir():
        return read_poses(path, times)
    if (folder := find_kiss_slam(path)) is not None:
        return read_kiss_poses(folder)
    if is_glim(path):
        return PoseList.of(read_glim_poses(path))
    raise UserError(f"{path}: neither KISS-SLAM's folder of results nor GLIM's dump; give a file of poses")


def _map_scans(path: Path, cloud: Path, times: Path | None) -> MapScans:
    poses = _poses(path, times)
    if cloud.suffix.lower() not in READERS:
        raise UserError(f"{cloud}: not a map that can be read; give one of {', '.join(READERS)}")
    try:
        points = np.asarray(read_points(cloud), np.float64)
    except UnreadableScanError as error:
        raise UserError(f"{cloud}: {error}") from None
    stamps = walking_stamps(poses.poses) if poses.stamps_ns is None else poses.stamps_ns
    points = points[np.isfinite(points).all(axis=1)]
    scans = MapScans(cloud, Trajectory(stamps, poses.poses), [MapPiece(points, np.arange(len(stamps)))])
    if poses.stamps_ns is None:
        scans.note = "the poses have no stamps; a sensor speed of 1 m/s is assumed"
    return scans
