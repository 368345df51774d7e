"""Writes one scan: points (N, 3) float32 in metres, sensor frame; intensity 0 where the format has one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float32]


def _with_intensity(points: Points) -> Points:
    return np.column_stack([points, np.zeros(len(points), np.float32)])


def _write_bin(path: Path, points: Points) -> None:
    """KITTI: float32 x y z intensity."""
    _with_intensity(points).tofile(path)


def _write_npy(path: Path, points: Points) -> None:
    np.save(path, points)


def _write_pcd(path: Path, points: Points) -> None:
    from pypcd4 import Encoding, PointCloud

    PointCloud.from_xyzi_points(_with_intensity(points)).save(path, encoding=Encoding.BINARY)


def _write_ply(path: Path, points: Points) -> None:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


SCAN_WRITERS: dict[str, Callable[[Path, Points], None]] = {
    "bin": _write_bin, "pcd": _write_pcd, "ply": _write_ply, "npy": _write_npy,
}  # fmt: skip
