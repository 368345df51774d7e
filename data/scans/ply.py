"""Point clouds as binary PLY files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.files import atomic_file

_FAR = 4096.0  # m from zero up to which single precision is exact to half a millimetre
_BATCH = 1 << 16


def write_ply(
    path: Path, points: NDArray[np.floating], comment: str = "", rgb: NDArray[np.uint8] | None = None,
    scalars: Mapping[str, NDArray[np.floating]] | None = None,
) -> None:  # fmt: skip
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
