"""Baseline: each scan is registered to the surfaces of the BIM, from the true initial pose.

GICP (Segal et al., RSS 2009) of small_gicp, with constant-velocity prediction. It builds no map, needs no matching and
assumes that the plan is correct.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.plans.mesh_plan import is_mesh
from data.scans import Scan
from data.trajectory import Trajectory

Array = NDArray[np.float64]
KINDS = ("Wall", "CurtainWall", "Slab", "Roof", "Covering", "Column", "Window", "Stair", "StairFlight")
CLASSES = tuple(f"Ifc{kind}" for kind in KINDS)
DENSITY = 400.0  # points per square metre of the target: enough for both sides of thin walls
SOURCE_VOXEL_M = 0.2
CORRESPONDENCE_M = 0.3  # below the height of furniture
BELOW_M, ABOVE_M = 2.5, 4.0  # extent of the target below and above the sensor


def register_to_bim(scans: Iterable[Scan], surfaces_in_bim: Array, T_bim_first: Array) -> Trajectory:
    """T_bim_sensor of all scans, from `surfaces_in_bim` (M, 3, 3) triangles and `T_bim_first` (4, 4), the true first
    pose. Raises UserError if there is no surface around the start."""
    z = surfaces_in_bim[:, :, 2] - T_bim_first[2, 3]
    near = surfaces_in_bim[(z.max(axis=1) > -BELOW_M) & (z.min(axis=1) < ABOVE_M)]
    if not len(near):
        raise UserError("ICP to the BIM: it has no surface around the start; use another building")
    origin = T_bim_first[:3, 3].copy()  # a site may lie kilometres from zero
    align = _gicp(_sampled(near) - origin)
    T = T_bim_first.copy()
    T[:3, 3] -= origin
    step = np.eye(4)
    stamps: list[int] = []
    poses: list[Array] = []
    for scan in scans:
        found = align(scan.points, T @ step if poses else T)
        if poses:
            step = np.linalg.inv(T) @ found
        T = found
        stamps.append(scan.stamp_ns)
        poses.append(found)
    in_bim = np.array(poses)
    in_bim[:, :3, 3] += origin
    return Trajectory(np.array(stamps, dtype=np.int64), in_bim)


def _gicp(target: Array) -> Callable[[Array, Array], Array]:
    """T_target_sensor by GICP of points (N, 3), sensor frame, from a guess, to points (M, 3) of the surfaces."""
    import small_gicp

    points, tree = small_gicp.preprocess_points(target, downsampling_resolution=0.05)

    def align(scan: Array, guess: Array) -> Array:
        source, _ = small_gicp.preprocess_points(scan, downsampling_resolution=SOURCE_VOXEL_M)
        found = small_gicp.align(
            points, source, tree, guess, registration_type="GICP", max_correspondence_distance=CORRESPONDENCE_M
        )
        return np.asarray(found.T_target_source)

    return align


def surfaces_of(bim: Path) -> Array:
    """(M, 3, 3) triangles of a mesh, or of an IFC model's walls, slabs, columns and windows.

    Floors and ceilings are also taken from the spaces, since many models lack them. Raises UserError if there are none.
    """
    if is_mesh(bim):
        from data.plans.mesh_plan import read_mesh

        return np.asarray(read_mesh(bim).triangles)
    from data.ifc.products import open_ifc, products

    model = open_ifc(bim)
    parts = [p.vertices[p.faces] for p in products(model, CLASSES)]
    if not parts:
        raise UserError(f"{bim}: no walls and slabs; give a model with building elements")
    return np.concatenate([*parts, *(_level(p.vertices[p.faces]) for p in products(model, ("IfcSpace",)))])


def _level(triangles: Array) -> Array:
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return triangles[np.abs(normal[:, 2]) > 0.99 * np.linalg.norm(normal, axis=1)]


def _sampled(triangles: Array) -> Array:
    """Points (N, 3) sampled uniformly over the triangles, with a fixed seed."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(u, v), axis=1) / 2
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(triangles), int(DENSITY * area.sum()) + 1, p=area / area.sum())
    weights = rng.random((len(chosen), 2))
    weights[weights.sum(axis=1) > 1] = 1 - weights[weights.sum(axis=1) > 1]
    return np.asarray(triangles[chosen, 0] + weights[:, :1] * u[chosen] + weights[:, 1:] * v[chosen])
