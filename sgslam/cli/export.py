"""`python -m sgslam.cli.export --out OUT --format NAME ...`: exports a finished run to the formats of other programs.

All files are written to the run's folder, in the frame of its `trajectory.tum`. Some formats need the building's model
(`--bim`): `as_built.ifc` is a copy of the model with the verdict on each element (property set `AsBuilt`, and colours);
`deviations.bcf` (BCF 2.1) and `deviations_3.0.bcf` have a topic for each wall that deviates from the plan;
`cloud-to-model`, which needs the extra `open3d` too, is the distance of every point of the map from the planned face
that it was measured on.
"""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from data.common.cli import Parser, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    from sgslam.report import RunFolder

IFC = "as_built.ifc"


def export(
    out: Path, formats: list[str], bim: Path | None = None, voxel: float | None = None, georeferenced: bool = False
) -> list[str]:
    """Writes the formats (names in FORMATS, or `all` for every possible one); returns one line for each file, and for
    what is left out of `all`.

    `voxel` is the side of the point cloud map's voxels (m); None takes the run's setting. `georeferenced`: poses and
    point clouds in map coordinates. Raises UserError for a folder that is not a run's or lacks needed files, a format
    that needs `bim` if it is not given, `ifc` and `bcf` of a run that is not anchored, a model that cannot be read or
    has none of the run's walls, and map coordinates that are not known.
    """
    from sgslam.report import RunFolder

    run, lines, without = RunFolder.read(out), list[str](), dict[str, str]()
    run = run.on_map() if georeferenced else run
    if "all" in formats:
        if run.T_bim_map is None:
            without = dict.fromkeys(NEED_MODEL, "the run was not anchored")
        elif bim is None:
            without = dict.fromkeys(NEED_MODEL, "give the run's model, --bim FILE")
        elif find_spec("open3d") is None:
            without = {"cloud-to-model": "pip install 'sgslam[open3d]'"}
        formats = [name for name in FORMATS if name not in without]
    for name in formats:
        if name in NEED_MODEL:
            if bim is None:
                raise UserError(f"--format {name}: needs the run's IFC model; give --bim too")
            run.anchored()
        lines += FORMATS[name](run, bim or Path(), voxel or run.config.clouds.map_voxel)
    return [*lines, *(f"{name}: left out; {why}" for name, why in without.items())]


def _kitti(run: "RunFolder", bim: Path, voxel: float) -> list[str]:
    from data.trajectory.trajectory import write_kitti

    trajectory = run.trajectory
    poses, times = run.path / "trajectory.kitti", run.path / "trajectory_times.txt"
    write_kitti(trajectory, poses, times)
    return [f"{poses}: {len(trajectory)} poses; times in {times.name}"]


def _ply(run: "RunFolder", bim: Path, voxel: float) -> list[str]:
    from data.scans.writers import write_ply

    file = run.path / "map.ply"
    points, _ = run.map_points(voxel)
    points = points if run.georeference is None else run.georeference.on_map(points)
    frame = f"{run.frame} frame" if run.georeference is None else run.georeference.crs
    write_ply(file, points, f"{frame}, metres, voxels of {voxel:g} m")
    return [f"{file}: {len(points)} points, voxels of {voxel:g} m"]


def _ifc(run: "RunFolder", bim: Path, voxel: float) -> list[str]:
    from data.ifc.deviations import write_as_built

    _require_elements(run)
    target, unplanned = run.path / IFC, [own for own in run.unplanned if own["kind"] == "wall-like"]
    marked = write_as_built(bim, run.elements, unplanned, target)
    if run.elements and not marked:
        target.unlink()
        raise UserError(f"{bim}: has none of the elements of {run.path}; give the model of that run")
    return [f"{target}: {marked} elements with the property set AsBuilt, {len(unplanned)} unplanned walls added"]


def _bcf(run: "RunFolder", bim: Path, voxel: float) -> list[str]:
    from data.ifc.bcf import Model
    from data.ifc.deviations import project_of
    from sgslam.as_built.findings import BCF, write_topics

    _require_elements(run)
    a_graph, _ = run.anchored()
    count = write_topics(run.path, run.elements, run.unplanned, a_graph, Model(bim.name, project_of(bim)))
    return [f"{run.path / name}: {count} topics, BCF {version}" for version, name in BCF.items()]


def _require_elements(run: "RunFolder") -> None:
    if not run.elements:
        raise UserError(f"{run.path}: has no elements.json, which an anchored run writes itself; run it again")


def _cloud_to_model(run: "RunFolder", bim: Path, voxel: float) -> list[str]:
    from data.plans.elements import planned_elements
    from sgslam.as_built.elements.files import write_tables
    from sgslam.cloud_to_model import distances_to_model, load_open3d
    from sgslam.cloud_to_model.files import write_cloud_to_model

    load_open3d()  # refused before anything is computed
    points, towards = run.map_points(voxel)
    elements, settings = planned_elements(bim), run.config.as_built
    found = distances_to_model(points, towards, elements, settings.cloud_reach)
    cloud, *others = write_cloud_to_model(run.path, found, elements, settings.tolerance)
    if run.elements:
        write_tables(run.path, run.elements, run.unplanned)  # with the pictures
    share = f"{found.compared.mean():.0%}" if len(points) else "none"
    near = f"{cloud}: {len(points)} points, {share} of them within {found.reach:g} m of a planned face"
    return [near, *map(str, others)]


FORMATS: dict[str, Callable[["RunFolder", Path, float], list[str]]] = {
    "kitti": _kitti,
    "ply": _ply,
    "ifc": _ifc,
    "bcf": _bcf,
    "cloud-to-model": _cloud_to_model,
}
NEED_MODEL = ("ifc", "bcf", "cloud-to-model")


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    about, names = "Export a finished run to the formats of other programs.", [*FORMATS, "all"]
    parser = Parser(prog="python -m sgslam.cli.export", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="--out folder of a run; the files are written into it")
    formats = f"one or more of {', '.join(FORMATS)}, or all"
    add("--format", nargs="+", choices=names, default=[], metavar="NAME", help=formats)
    add("--bim", type=Path, metavar="FILE", help=f"the run's IFC model; needed for {', '.join(NEED_MODEL)}")
    add("--voxel", type=float, metavar="M", help="voxel size of the point cloud, metres (default: the run's)")
    on_map = "kitti and ply in the map coordinates of the model's IfcMapConversion"
    add("--georeferenced", action="store_true", help=on_map)
    options = parser.parse_args(arguments)
    if options.voxel is not None and not 1e-3 <= options.voxel <= 10:
        raise UserError(f"--voxel {options.voxel:g}: out of range; give 0.001 to 10 metres")
    if not options.format:
        raise UserError(f"--format is missing; give {formats}")
    for line in export(options.out, options.format, options.bim, options.voxel, options.georeferenced):
        print(line)
    return 0


if __name__ == "__main__":
    run_command(main)
