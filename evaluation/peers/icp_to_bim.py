"""Baselines: register each scan to the surfaces of the BIM, from the true initial pose.

GICP (Segal et al., RSS 2009) of small_gicp, or multi-scale point-to-plane ICP of Open3D, with constant-velocity
prediction. They build no map, need no matching and assume that the plan is correct.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.plans.mesh_files import is_mesh
from data.scans import Scan
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.cloud_to_model import load_open3d

Array = NDArray[np.float64]
CLASSES = (
    "IfcWall", "IfcCurtainWall", "IfcSlab", "IfcRoof", "IfcCovering", "IfcColumn", "IfcWindow", "IfcStair",
    "IfcStairFlight",
)  # fmt: skip
DENSITY = 400.0  # points per square metre of the target: enough for both sides of thin walls
SOURCE_VOXEL_M = 0.2
CORRESPONDENCE_M = 0.3  # below the height of furniture
BELOW_M, ABOVE_M = 2.5, 4.0  # extent of the target below and above the sensor
SCALES_M, ITERATIONS = (0.4, 0.2, 0.1), (20, 15, 10)  # voxels of the multi-scale ICP, and its steps in each
Align = Callable[[Array, Array], Array]  # T_target_sensor of points (N, 3), sensor frame, from a guess


def register_to_bim(
    scans: Iterable[Scan], surfaces_in_bim: Array, T_bim_first: Array, aligner: Callable[[Array], Align]
) -> Trajectory:
    """T_bim_sensor of all scans, from `surfaces_in_bim` (M, 3, 3) triangles and `T_bim_first` (4, 4), the true first
    pose; `aligner` is one of ALIGNERS. Raises UserError if there is no surface around the start, and as the aligner
    does."""
    z = surfaces_in_bim[:, :, 2] - T_bim_first[2, 3]
    near = surfaces_in_bim[(z.max(axis=1) > -BELOW_M) & (z.min(axis=1) < ABOVE_M)]
    if not len(near):
        raise UserError("ICP to the BIM: it has no surface around the start; use another building")
    origin = T_bim_first[:3, 3].copy()  # a site may lie kilometres from zero
    align = aligner(_sampled(near) - origin)
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


def gicp(target: Array) -> Align:
    """GICP to points (N, 3) of the surfaces."""
    import small_gicp

    points, tree = small_gicp.preprocess_points(target, downsampling_resolution=0.05)

    def align(scan: Array, guess: Array) -> Array:
        source, _ = small_gicp.preprocess_points(scan, downsampling_resolution=SOURCE_VOXEL_M)
        found = small_gicp.align(
            points, source, tree, guess, registration_type="GICP", max_correspondence_distance=CORRESPONDENCE_M
        )
        return np.asarray(found.T_target_source)

    return align


def multi_scale_icp(target: Array) -> Align:
    """Point-to-plane ICP to points (N, 3) of the surfaces, first of coarse voxels, then of fine ones. Raises UserError
    without Open3D."""
    o3d = load_open3d()
    steps = o3d.t.pipelines.registration
    surface = o3d.t.geometry.PointCloud(o3d.core.Tensor(target))
    surface.estimate_normals(max_nn=20, radius=SCALES_M[-1])
    voxels, reaches = (o3d.utility.DoubleVector(own) for own in (SCALES_M, [2 * voxel for voxel in SCALES_M]))
    criteria = [steps.ICPConvergenceCriteria(1e-6, 1e-6, count) for count in ITERATIONS]
    planes = steps.TransformationEstimationPointToPlane()

    def align(scan: Array, guess: Array) -> Array:
        source = o3d.t.geometry.PointCloud(o3d.core.Tensor(scan))
        found = steps.multi_scale_icp(source, surface, voxels, criteria, reaches, o3d.core.Tensor(guess), planes)
        return np.asarray(found.transformation.numpy())

    return align


ALIGNERS = {"ICP to the BIM": gicp, "multi-scale ICP to the BIM": multi_scale_icp}  # by variant


def surfaces_of(bim: Path, a_graph: SceneGraph) -> Array:
    """(M, 3, 3) triangles of the surfaces of a building's file. Raises UserError if there are none."""
    if is_mesh(bim):
        from data.plans.mesh_plan import read_mesh

        return np.asarray(read_mesh(bim).triangles)
    return surfaces_of_graph(a_graph) if bim.suffix.lower() == ".json" else surfaces_of_ifc(bim)


def surfaces_of_ifc(path: Path) -> Array:
    """(M, 3, 3) triangles of walls, slabs, columns and windows, without doors and furniture.

    Floors and ceilings are also taken from the spaces, since many models lack them. Raises UserError if there are none.
    """
    from data.ifc.products import open_ifc, products

    model = open_ifc(path)
    parts = [p.vertices[p.faces] for p in products(model, CLASSES)]
    if not parts:
        raise UserError(f"{path}: no walls and slabs; give a model with building elements")
    return np.concatenate([*parts, *(_level(p.vertices[p.faces]) for p in products(model, ("IfcSpace",)))])


def surfaces_of_graph(a_graph: SceneGraph) -> Array:
    """(M, 3, 3) triangles of an A-graph's wall surfaces and of the floors of its rooms."""
    elevation = {f.id: f.elevation or 0.0 for f in a_graph.floors}
    triangles = []
    for w in a_graph.wall_surfaces:
        level = elevation.get(w.floor or "", 0.0)
        low, high = w.height or (level, level + 2.5)
        (x0, y0), (x1, y1) = w.ends()
        a, b, c, d = ([x0, y0, low], [x1, y1, low], [x1, y1, high], [x0, y0, high])
        triangles += [[a, b, c], [a, c, d]]
    for room in a_graph.rooms:
        if room.polygon is not None:
            triangles += _fan(np.array(room.polygon), elevation.get(room.floor or "", 0.0))
    return np.array(triangles)


def _level(triangles: Array) -> Array:
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return triangles[np.abs(normal[:, 2]) > 0.99 * np.linalg.norm(normal, axis=1)]


def _fan(polygon: Array, z: float) -> list[list[list[float]]]:
    import shapely

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(polygon)))
    return [[[x, y, z] for x, y in part.exterior.coords[:3]] for part in parts]


def _sampled(triangles: Array) -> Array:
    """Points (N, 3) sampled uniformly over the triangles, with a fixed seed."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(u, v), axis=1) / 2
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(triangles), int(DENSITY * area.sum()) + 1, p=area / area.sum())
    weights = rng.random((len(chosen), 2))
    weights[weights.sum(axis=1) > 1] = 1 - weights[weights.sum(axis=1) > 1]
    return np.asarray(triangles[chosen, 0] + weights[:, :1] * u[chosen] + weights[:, 1:] * v[chosen])
