"""GLIM's dump (github.com/koide3/glim): a trajectory, and submaps with their points.

Its factor graph (`graph.bin`, `values.bin`) is in GTSAM's own binary form and is not read, nor are the covariances of
the points.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.slam_output.map_scans import MapPiece, MapScans
from data.trajectory import Trajectory
from data.trajectory.readers import squared
from data.trajectory.stamps import seconds_to_ns

Floats = NDArray[np.float64]
_TRAJECTORY, _DATA, _POINTS = "traj_lidar.txt", "data.txt", "points_compact.bin"
_SAME_NS = 1_000_000  # by which stamps of one frame differ that were printed twice


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
    try:
        lines = path.read_text().splitlines()
        begin = next(k for k, line in enumerate(lines) if line.startswith("T_world_origin:"))
        rows = [[float(word) for word in line.split()] for line in lines[begin + 1 : begin + 5]]
        pose = squared(np.array(rows, np.float64).reshape(4, 4))
        stamps = [seconds_to_ns(line.split()[1]) for line in lines if line.startswith("stamp:")]
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, StopIteration, IndexError):
        raise UserError(f"{path}: not as GLIM writes it: no T_world_origin (4 x 4) or no stamps of frames") from None
    if not stamps:
        raise UserError(f"{path}: names no frame; give an undamaged dump")
    return pose, np.array(sorted(stamps), np.int64)


def _read_points(path: Path) -> Floats:
    """(N, 3) the points of a submap, stored as float32 x y z. Raises UserError."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give an undamaged dump") from None
    if len(raw) % 12:
        raise UserError(f"{path}: {len(raw)} bytes are not a whole number of float32 x y z")
    points = np.frombuffer(raw, "<f4").reshape(-1, 3).astype(np.float64)
    return np.asarray(points[np.isfinite(points).all(axis=1)])
