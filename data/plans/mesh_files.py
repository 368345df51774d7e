"""Meshes of buildings from files: metres, z up."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError

MESH_SUFFIXES = (".stl", ".dae", ".obj", ".ply")
HIGHEST = 400.0  # m: what is higher is not in metres
WIDEST = 20_000.0  # m: likewise


def is_mesh(path: Path | str) -> bool:
    """Whether a file's suffix is that of a mesh."""
    return Path(path).suffix.lower() in MESH_SUFFIXES


def read_triangles(path: Path | str, *more: Path | str) -> NDArray[np.float64]:
    """Returns (M, 3, 3) the triangles of one or more `.stl`, `.dae`, `.obj` or `.ply` files, in metres with z up.

    COLLADA's unit and up axis are used; the other formats do not state theirs and are taken as metres with z up. Raises
    UserError for a file that is missing, of another kind, unreadable or empty, and if all together are implausibly
    large.
    """
    triangles = np.concatenate([_triangles(Path(p)) for p in (path, *more)])
    with np.errstate(over="ignore"):
        *width, height = np.ptp(triangles.reshape(-1, 3), axis=0).tolist()
    if not 1.0 < height < HIGHEST or not max(width) < WIDEST:
        size = f"{height:g} m high and up to {max(width):g} m wide"
        raise UserError(f"{path}: is {size}; give a building in metres with z up")
    return triangles


def _triangles(path: Path) -> NDArray[np.float64]:
    import trimesh

    if not path.is_file() or not is_mesh(path):
        raise UserError(f"{path}: not a mesh; give a file that ends in {', '.join(MESH_SUFFIXES)}")
    try:
        scene = trimesh.load_scene(path)
        triangles = np.asarray(scene.to_mesh().triangles, dtype=float)
    except Exception as error:  # trimesh's readers raise kinds of their own
        missing = path.suffix.lower() == ".dae" and isinstance(error, (ImportError, NotImplementedError, ValueError))
        hint = "; COLLADA needs pycollada: pip install 'sgslam[mesh]'" if missing else ""
        raise UserError(f"{path}: cannot be read as a mesh ({type(error).__name__}){hint}") from None
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3):
        raise UserError(f"{path}: contains faces that are not triangles in 3D")
    if path.suffix.lower() == ".dae":
        triangles = _upright(triangles, path)
    if not len(triangles) or not np.isfinite(triangles).all():
        raise UserError(f"{path}: contains no triangles, or some that are not finite")
    return triangles


def _upright(triangles: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """Converts to metres with z up, as stated by the file's `asset`."""
    import collada

    asset = collada.Collada(str(path), ignore=[collada.DaeError]).assetInfo
    axes = {"X_UP": (1, 2, 0), "Y_UP": (2, 0, 1), "Z_UP": (0, 1, 2)}[asset.upaxis or "Y_UP"]
    return np.asarray(triangles[:, :, axes] * (asset.unitmeter or 1.0))
