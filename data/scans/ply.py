"""Point clouds as binary PLY files."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.files import atomic_file

_FAR = 4096.0  # m from zero up to which single precision is exact to half a millimetre


def write_ply(path: Path, points: NDArray[np.floating], comment: str = "") -> None:
    """Writes points (N, 3) atomically; as `float`, far from zero (a site in national coordinates) as `double`."""
    far = len(points) > 0 and float(np.abs(points).max()) > _FAR
    kind, name = ("<f8", "double") if far else ("<f4", "float")
    head = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    head += [f"element vertex {len(points)}", *(f"property {name} {axis}" for axis in "xyz"), "end_header"]
    with atomic_file(path) as file:
        file.write(("\n".join(head) + "\n").encode())
        for part in range(0, len(points), 1 << 16):
            file.write(points[part : part + (1 << 16)].astype(kind).tobytes())
