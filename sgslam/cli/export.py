"""`python -m sgslam.cli.export --out OUT --format NAME ...`: exports a finished run to the formats of other programs.

All files are written to the run's folder, in the frame of its `trajectory.tum`. The default formats are `ifc` and
`bcf`, which need the building's model (`--bim`): `as_built.ifc` is a copy of the model with the verdict on
each element (property set `AsBuilt`, and colours); `deviations.bcf` (BCF 2.1) and `deviations_3.0.bcf` have a topic for
each wall that deviates from the plan. `cloud-to-model` needs it too, and the extra `open3d`: the distance of every
point of the map from the planned face that it was measured on.
"""

import argparse
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from data.trajectory import Trajectory
    from sgslam.report import RunFolder

IFC = "as_built.ifc"
KITTI, KITTI_TIMES, EUROC, PLY = "trajectory.kitti", "trajectory_times.txt", "trajectory_euroc.csv", "map.ply"


def export(out: Path, formats: list[str], bim: Path | None = None, voxel: float | None = None) -> list[str]:
    """Writes the formats (names in FORMATS, or `all` for every possible one); returns one line per file.

    `voxel` is the side of the point cloud map's voxels (m); None takes the run's setting. Raises UserError for a folder
    that is not a run's or lacks needed files, a format that needs `bim` if it is not given, `ifc` and `bcf` of a run
    that is not anchored, and a model that cannot be read or has none of the run's walls.
    """
    from sgslam.report import RunFolder

    run = RunFolder.read(out)
    if "all" in formats:
        formats = _possible(bim is not None and run.T_bim_map is not None)
    if bim is None and (lacking := _NEED_MODEL.intersection(formats)):
        raise UserError(f"--format {' '.join(sorted(lacking))}: needs the run's IFC model; give --bim too")
    return [line for name in formats for line in FORMATS[name](run, bim, voxel)]


def _possible(has_model: bool) -> list[str]:
    """The formats that need neither a model that is not there nor an extra that is not installed."""
    lacking = set() if has_model else set(_NEED_MODEL)
    lacking |= {name for name, package in _NEED_PACKAGE.items() if find_spec(package) is None}
    return [name for name in FORMATS if name not in lacking]


def _trajectory(run: "RunFolder") -> "Trajectory":
    from data.trajectory import Trajectory

    return Trajectory.read_tum(run.path / "trajectory.tum")


def _kitti(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.trajectory.readers import write_kitti

    trajectory = _trajectory(run)
    write_kitti(trajectory, run.path / KITTI, run.path / KITTI_TIMES)
    return [f"{run.path / KITTI}: {len(trajectory)} poses; times in {KITTI_TIMES}"]


def _euroc(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.trajectory.readers import write_euroc

    trajectory = _trajectory(run)
    write_euroc(trajectory, run.path / EUROC)
    return [f"{run.path / EUROC}: {len(trajectory)} poses"]


def _ply(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.scans.writers import write_ply

    voxel = voxel or run.config.clouds.map_voxel
    points, _, keyframes = map_points(run, voxel)
    write_ply(run.path / PLY, points, f"{run.frame} frame, metres, voxels of {voxel:g} m")
    return [f"{run.path / PLY}: {len(points)} points of {keyframes} keyframes, voxels of {voxel:g} m"]


def map_points(run: "RunFolder", voxel: float) -> "tuple[NDArray[np.float64], NDArray[np.float64], int]":
    """The point cloud map (N, 3) in the run's frame, unit vectors (N, 3) towards the sensor, and the number of
    keyframes that it is made of."""
    from sgslam.mapping import KeyframeClouds
    from sgslam.mapping.cloud_map import cloud_map
    from sgslam.mapping.keyframe_clouds import FILE

    clouds = KeyframeClouds.open(run.path / FILE)
    return *cloud_map(clouds, run.poses_by_keyframe, voxel), len(clouds)


def _dsg(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.common.files import write_json
    from sgslam.export.dsg import FILE, dsg

    graph = dsg(run)
    write_json(run.path / FILE, graph)
    return [f"{run.path / FILE}: {len(graph['nodes'])} nodes, {len(graph['edges'])} edges"]


def _g2o(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from sgslam.backend.pose_graph import FILE

    if not (run.path / FILE).is_file():
        raise UserError(f"{run.path}: {FILE} is missing, which a run writes itself; run it again")
    return [f"{run.path / FILE}: already written by the run"]


def _ifc(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.ifc.deviations import write_as_built
    from sgslam.as_built.findings import element_findings, unplanned_findings

    assert bim is not None
    a_graph, _ = run.anchored()
    findings, unplanned = element_findings(_elements(run)), unplanned_findings(run.unplanned, a_graph)
    target = run.path / IFC
    marked = write_as_built(bim, findings, unplanned, target)
    if findings and not marked:
        target.unlink()
        raise UserError(f"{bim}: has none of the elements of {run.path}; give the model of that run")
    return [f"{target}: {marked} elements with the property set AsBuilt, {len(unplanned)} unplanned walls added"]


def _elements(run: "RunFolder") -> list[dict[str, Any]]:
    """The entries of elements.json. Raises UserError where the run has none."""
    if not run.elements:
        raise UserError(f"{run.path}: has no elements.json, which an anchored run writes itself; run it again")
    return run.elements


def _bcf(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.ifc.bcf import Model
    from data.ifc.deviations import project_of
    from sgslam.as_built.findings import BCF, write_topics

    assert bim is not None
    a_graph, _ = run.anchored()
    model = Model(bim.name, project_of(bim))
    count = write_topics(run.path, _elements(run), run.unplanned, a_graph, model)
    return [f"{run.path / name}: {count} topics, BCF {version}" for version, name in BCF.items()]


def _cloud_to_model(run: "RunFolder", bim: Path | None, voxel: float | None) -> list[str]:
    from data.plans.elements import planned_elements
    from sgslam.as_built.elements.files import write_tables
    from sgslam.cloud_to_model import distances_to_model, load_open3d
    from sgslam.cloud_to_model.files import write_cloud_to_model

    assert bim is not None
    run.anchored()
    load_open3d()  # refused before anything is computed
    points, towards, _ = map_points(run, voxel or run.config.clouds.map_voxel)
    elements = planned_elements(bim)
    settings = run.config.as_built
    found = distances_to_model(points, towards, elements, settings.cloud_reach)
    cloud, table, *others = write_cloud_to_model(run.path, found, elements, settings.tolerance)
    if run.elements:
        write_tables(run.path, run.elements, run.unplanned)  # with the pictures
    share = f"{found.compared.mean():.0%}" if len(points) else "none"
    lines = [f"{cloud}: {len(points)} points, {share} of them within {found.reach:g} m of a planned face", str(table)]
    return [*lines, *map(str, others)]


FORMATS: dict[str, Callable[["RunFolder", Path | None, float | None], list[str]]] = {
    "kitti": _kitti, "euroc": _euroc, "ply": _ply, "dsg": _dsg, "g2o": _g2o, "ifc": _ifc, "bcf": _bcf,
    "cloud-to-model": _cloud_to_model,
}  # fmt: skip
_NEED_MODEL = {"ifc", "bcf", "cloud-to-model"}
_NEED_PACKAGE = {"cloud-to-model": "open3d"}
_GONE = {
    "graphml": "read s_graph.json",
    "mcap": "use sgslam run --rerun FILE, or sgslam view OUT",
    "pdf": "print report.html from a browser",
}  # what to use instead


def _format(name: str) -> str:
    """A name of a format as an option of the command line."""
    if name in _GONE:
        raise argparse.ArgumentTypeError(f"{name} is gone; {_GONE[name]}")
    return name


def _parser() -> argparse.ArgumentParser:
    about = "Export a finished run to the formats of other programs."
    parser = Parser(prog="python -m sgslam.cli.export", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="--out folder of a run; the files are written into it")
    add("--format", nargs="+", type=_format, choices=[*FORMATS, "all"], default=["ifc", "bcf"], metavar="NAME",
        help=f"one or more of {', '.join(FORMATS)}, or all (default: ifc bcf)")  # fmt: skip
    add("--bim", type=Path, metavar="FILE", help="the run's IFC model; needed for ifc, bcf and cloud-to-model")
    add("--voxel", type=float, metavar="M", help="voxel size of the point cloud, metres (default: the run's)")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    options = _parser().parse_args(arguments)
    if options.voxel is not None and not 1e-3 <= options.voxel <= 10:
        raise UserError(f"--voxel {options.voxel:g}: out of range; give 0.001 to 10 metres")
    for line in export(options.out, options.format, options.bim, options.voxel):
        print(line)
    return 0


if __name__ == "__main__":
    run_command(main)
