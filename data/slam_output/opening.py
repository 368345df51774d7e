"""The output of other SLAM systems as scans with poses: files of poses, and KISS-SLAM's folder.

KISS-SLAM's folder of results (github.com/PRBonn/kiss-slam, 0.0.2) has a pose for each scan, and local maps. Its factor
graphs (`trajectory.g2o`, `local_map_graph.g2o`) weight all edges alike: they tell nothing of how uncertain a pose is,
and are not read.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UnreadableScanError, UserError
from data.common.files import parsed_lines
from data.scans.formats import READERS, read_points
from data.scans.point_times import Stamped
from data.scans.scan import ScanSource
from data.scans.sources import open_scans
from data.slam_output.g2o import read_graph_poses
from data.slam_output.map_scans import MapScans
from data.slam_output.posed_scans import PosedScans, walking_stamps
from data.trajectory import Trajectory
from data.trajectory.stamps import seconds_to_ns
from data.trajectory.trajectory import PoseList, read_kitti, read_poses

_MAPS = Path("local_maps") / "plys"  # in the frame of the poses
Floats = NDArray[np.float64]


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
    poses = read_kitti(texts[0])  # in full precision
    return PoseList(poses, _stamps(folder / f"{stem}_tum.txt", len(poses)), at_ends=True)


def _read_map(path: Path) -> Floats:
    try:
        points = np.asarray(read_points(path), np.float64)
    except UnreadableScanError as error:
        raise UserError(f"{path}: {error}") from None
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _stamps(path: Path, count: int) -> NDArray[np.int64] | None:
    """(count,) the stamps in the first column of a file; None where there are none."""
    if not path.is_file():
        return None
    lines = parsed_lines(path, "stamps in seconds in the first column", lambda text: seconds_to_ns(text.split()[0]))
    found = np.array(lines, np.int64)
    return None if len(found) != count or np.any(found[1:] <= found[:-1]) else found


def open_slam_output(
    path: Path, scans: Path | None = None, topic: str | None = None, cloud: Path | None = None,
    times: Path | None = None, stamped: Stamped = "auto",
) -> ScanSource:  # fmt: skip
    """Opens a file of poses (a factor graph as `.g2o` is one too) or KISS-SLAM's folder.

    `scans` are those that the system saw, or a cloud for each pose, of a bag those of a `topic`; `cloud` is its map, in
    the frame of the poses. KISS-SLAM's own maps need neither. `times` has the stamps of KITTI's poses;
    `stamped` is that of `open_scans`. Raises UserError.
    """
    if scans is not None and cloud is not None:
        raise UserError("--scans and --cloud: give only one of them")
    if times is not None and path.is_dir():
        raise UserError(f"{times}: only files of poses need --times; leave it out")
    if path.is_dir():
        folder = find_kiss_slam(path)
        if folder is None:
            raise UserError(f"{path}: not KISS-SLAM's folder of results; give a file of poses")
        poses, maps = read_kiss_poses(folder), sorted((folder / _MAPS).glob("*.ply"))
    else:
        poses, maps = read_graph_poses(path) if path.suffix.lower() == ".g2o" else read_poses(path, times), []
    if scans is not None:
        return PosedScans(open_scans(scans, topic, stamped), poses, str(path))
    if cloud is not None and cloud.suffix.lower() not in READERS:
        raise UserError(f"{cloud}: not a map that can be read; give one of {', '.join(READERS)}")
    clouds = [_read_map(own) for own in (maps if cloud is None else [cloud])]
    if not clouds:
        raise UserError(f"{path}: poses alone are not enough; give --scans (a folder or a bag) or --cloud (a map)")
    stamps = walking_stamps(poses.poses) if poses.stamps_ns is None else poses.stamps_ns
    source = MapScans(path if cloud is None else cloud, Trajectory(stamps, poses.poses), np.concatenate(clouds))
    if poses.stamps_ns is None:
        source.note = "the poses have no stamps; a sensor speed of 1 m/s is assumed"
    return source
