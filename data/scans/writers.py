"""Writes one scan: points (N, 3) float32 in metres, sensor frame; intensity 0 where the format has one; and the points'
times (N,) float32, seconds after the stamp, where they are given and the format can hold them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float32]
Times = NDArray[np.float32] | None


def _with_intensity(points: Points) -> Points:
    return np.column_stack([points, np.zeros(len(points), np.float32)])


def _write_bin(path: Path, points: Points, times: Times = None) -> None:
    """KITTI: float32 x y z intensity."""
    _with_intensity(points).tofile(path)


def _write_npy(path: Path, points: Points, times: Times = None) -> None:
    np.save(path, points)


def _write_pcd(path: Path, points: Points, times: Times = None) -> None:
    names = ["x", "y", "z", "intensity", *(["time"] if times is not None else [])]
    rows = np.column_stack([_with_intensity(points), *([times] if times is not None else [])])
    header = f"VERSION 0.7\nFIELDS {' '.join(names)}\n"
    for line, value in (("SIZE", " 4"), ("TYPE", " F"), ("COUNT", " 1")):
        header += f"{line}{value * len(names)}\n"
    header += f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    path.write_bytes(header.encode() + rows.astype("<f4").tobytes())


def _write_ply(path: Path, points: Points, times: Times = None) -> None:
    names = "xyz" if times is None else ("x", "y", "z", "time")
    rows = points if times is None else np.column_stack([points, times])
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(header.encode() + rows.astype("<f4").tobytes())


SCAN_WRITERS: dict[str, Callable[[Path, Points, Times], None]] = {
    "bin": _write_bin, "pcd": _write_pcd, "ply": _write_ply, "npy": _write_npy,
}  # fmt: skip
WITH_TIMES = ("pcd", "ply")  # formats that hold the points' times
