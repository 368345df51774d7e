"""The output of other SLAM systems as scans with poses: files of poses, and two systems' folders.

KISS-SLAM's folder of results (github.com/PRBonn/kiss-slam, 0.0.2) has a pose for each scan, and local maps. Its factor
graphs (`trajectory.g2o`, `local_map_graph.g2o`) weight all edges alike: they tell nothing of how uncertain a pose is,
and are not read. GLIM's dump (github.com/koide3/glim) has a trajectory, and submaps with their points. Its factor graph
(`graph.bin`, `values.bin`) is in GTSAM's own binary form and is not read, nor are the covariances of the points.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UnreadableScanError, UserError, refusing
from data.common.files import parsed_lines
from data.scans.formats import READERS, read_points
from data.scans.point_times import Stamped
from data.scans.scan import ScanSource
from data.scans.sources import open_scans
from data.slam_output.g2o import read_graph_poses
from data.slam_output.map_scans import MapPiece, MapScans
from data.slam_output.posed_scans import PosedScans, walking_stamps
from data.trajectory import Trajectory
from data.trajectory.readers import PoseList, read_kitti, read_poses, squared
from data.trajectory.stamps import seconds_to_ns

_NEITHER = "{}: neither KISS-SLAM's folder of results nor GLIM's dump; give a file of poses"
_MAPS = Path("local_maps") / "plys"  # in the frame of the poses
Floats = NDArray[np.float64]
_TRAJECTORY, _DATA, _POINTS = "traj_lidar.txt", "data.txt", "points_compact.bin"
_SAME_NS = 1_000_000  # by which stamps of one frame differ that were printed twice


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


def kiss_slam_scans(folder: Path) -> MapScans:
    """The points of the local maps as the poses saw them. Raises UserError if there are no local maps."""
    clouds = [_read_map(path) for path in sorted((folder / _MAPS).glob("*.ply"))]
    if not clouds:
        raise UserError(f"{folder}: no local maps ({_MAPS}/*.ply) in it; give its scans with --scans")
    return _map_scans(folder, read_kiss_poses(folder), np.concatenate(clouds))


def _map_scans(path: Path, poses: PoseList, points: Floats) -> MapScans:
    """The points (N, 3) of the map in `path` as all poses saw them."""
    stamps = walking_stamps(poses.poses) if poses.stamps_ns is None else poses.stamps_ns
    scans = MapScans(path, Trajectory(stamps, poses.poses), [MapPiece(points, np.arange(len(stamps)))])
    if poses.stamps_ns is None:
        scans.note = "the poses have no stamps; a sensor speed of 1 m/s is assumed"
    return scans


def _read_map(path: Path) -> Floats:
    try:
        return np.asarray(read_points(path), np.float64)
    except UnreadableScanError as error:
        raise UserError(f"{path}: {error}") from None


def _stamps(path: Path, count: int) -> NDArray[np.int64] | None:
    """(count,) the stamps in the first column of a file; None where there are none."""
    if not path.is_file():
        return None
    lines = parsed_lines(path, "stamps in seconds in the first column", lambda text: seconds_to_ns(text.split()[0]))
    found = np.array(lines, np.int64)
    return None if len(found) != count or np.any(found[1:] <= found[:-1]) else found


def is_glim(folder: Path) -> bool:
    """Whether a folder is a dump of GLIM."""
    return (folder / _TRAJECTORY).is_file() and any(folder.glob(f"[0-9]*/{_DATA}"))


def read_glim_poses(folder: Path) -> Trajectory:
    """The poses T_world_lidar of all frames. Raises UserError."""
    return Trajectory.read_tum(folder / _TRAJECTORY)


def glim_scans(folder: Path) -> MapScans:
    """The points of each submap as the poses of its own frames saw them. Raises UserError for a damaged dump."""
    trajectory = read_glim_poses(folder)
    submaps = sorted(path.parent for path in folder.glob(f"[0-9]*/{_DATA}"))
    return MapScans(folder, trajectory, [_read_submap(submap, trajectory) for submap in submaps])


def _read_submap(folder: Path, trajectory: Trajectory) -> MapPiece:
    T_world_origin, stamps = _read_data(folder / _DATA)
    points = _read_points(folder / _POINTS)
    apart = np.abs(trajectory.stamps_ns[None] - stamps[:, None])
    frames = np.unique(apart.argmin(axis=1)[apart.min(axis=1) <= _SAME_NS])
    if not len(frames):
        raise UserError(f"{folder / _DATA}: none of its frames is in {_TRAJECTORY}; give an undamaged dump")
    return MapPiece(points @ T_world_origin[:3, :3].T + T_world_origin[:3, 3], frames)


def _read_data(path: Path) -> tuple[Floats, NDArray[np.int64]]:
    """T_world_origin (4, 4) and the stamps (M,) of the frames of a submap. Raises UserError."""
    with refusing(f"{path}: not as GLIM writes it, with T_world_origin (4 x 4) and stamps of frames"):
        head, _, rest = path.read_text().partition("T_world_origin:")
        pose = squared(np.array(rest.split()[:16], np.float64).reshape(4, 4))
        stamps = [seconds_to_ns(line.split()[1]) for line in (head + rest).splitlines() if line.startswith("stamp:")]
        return pose, np.array(sorted(stamps), np.int64)


def _read_points(path: Path) -> Floats:
    """(N, 3) the points of a submap, stored as float32 x y z. Raises UserError."""
    with refusing(f"{path}: not float32 x y z", "give an undamaged dump"):
        points = np.frombuffer(path.read_bytes(), "<f4").reshape(-1, 3).astype(np.float64)
    return np.asarray(points[np.isfinite(points).all(axis=1)])


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
        if cloud.suffix.lower() not in READERS:
            raise UserError(f"{cloud}: not a map that can be read; give one of {', '.join(READERS)}")
        points = _read_map(cloud)
        return _map_scans(cloud, _poses(path, times), points[np.isfinite(points).all(axis=1)])
    if not path.is_dir():
        raise UserError(f"{path}: poses alone are not enough; give --scans (a folder or a bag) or --cloud (a map)")
    if (folder := find_kiss_slam(path)) is not None:
        return kiss_slam_scans(folder)
    if is_glim(path):
        return glim_scans(path)
    raise UserError(_NEITHER.format(path))


def _poses(path: Path, times: Path | None) -> PoseList:
    if path.suffix.lower() == ".g2o":
        return read_graph_poses(path)
    if not path.is_dir():
        return read_poses(path, times)
    if (folder := find_kiss_slam(path)) is not None:
        return read_kiss_poses(folder)
    if is_glim(path):
        return PoseList.of(read_glim_poses(path))
    raise UserError(_NEITHER.format(path))
