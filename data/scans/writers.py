"""Writes one scan: points (N, 3) float32 in metres, sensor frame; intensity 0 where the format has one; and the points'
times (N,) float32, seconds after the stamp, where they are given and the format can hold them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.files import atomic_file

Points = NDArray[np.float32]
Times = NDArray[np.float32] | None
_FAR = 4096.0  # m from zero up to which single precision is exact to half a millimetre
_BATCH = 1 << 16


def _with_intensity(points: Points) -> Points:
    return np.column_stack([points, np.zeros(len(points), np.float32)])


def _write_pcd(path: Path, points: Points, times: Times) -> None:
    names = ["x", "y", "z", "intensity", *(["time"] if times is not None else [])]
    rows = np.column_stack([_with_intensity(points), *([times] if times is not None else [])])
    header = f"VERSION 0.7\nFIELDS {' '.join(names)}\n"
    for line, value in (("SIZE", " 4"), ("TYPE", " F"), ("COUNT", " 1")):
        header += f"{line}{value * len(names)}\n"
    header += f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    path.write_bytes(header.encode() + rows.astype("<f4").tobytes())


SCAN_WRITERS: dict[str, Callable[[Path, Points, Times], None]] = {
    "bin": lambda path, points, times: _with_intensity(points).tofile(path),  # KITTI
    "pcd": _write_pcd,
    "ply": lambda path, points, times: write_ply(path, points, scalars=None if times is None else {"time": times}),
    "npy": lambda path, points, times: np.save(path, points),
}
WITH_TIMES = ("pcd", "ply")  # formats that hold the points' times


def write_ply(
    path: Path,
    points: NDArray[np.floating],
    comment: str = "",
    rgb: NDArray[np.uint8] | None = None,
    scalars: Mapping[str, NDArray[np.floating]] | None = None,
) -> None:
    """Writes points (N, 3) atomically; as `float`, far from zero (a site in national coordinates) as `double`.

    `rgb` (N, 3) are their colours, `scalars` (N,) further properties by name.
    """
    far = len(points) > 0 and float(np.abs(points).max()) > _FAR
    kind, name = ("<f8", "double") if far else ("<f4", "float")
    columns: list[tuple[str, str, str, NDArray[Any]]]
    columns = [(axis, kind, name, points[:, k]) for k, axis in enumerate("xyz")]
    if rgb is not None:
        columns += [(colour, "u1", "uchar", rgb[:, k]) for k, colour in enumerate(("red", "green", "blue"))]
    columns += [(title, "<f4", "float", values) for title, values in (scalars or {}).items()]
    head = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    head += [f"element vertex {len(points)}", *(f"property {name} {title}" for title, _, name, _ in columns)]
    with atomic_file(path) as file:
        file.write(("\n".join([*head, "end_header"]) + "\n").encode())
        for part in range(0, len(points), _BATCH):
            rows = np.empty(len(points[part : part + _BATCH]), [(title, form) for title, form, _, _ in columns])
            for title, _, _, values in columns:
                rows[title] = values[part : part + _BATCH]
            file.write(rows.tobytes())
