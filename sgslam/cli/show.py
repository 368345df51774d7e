"""`sgslam show OUT`: shows a finished run in Open3D's viewer on the desktop."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    from sgslam.report import RunFolder


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    parser = Parser(prog="python -m sgslam.cli.show", description="Show a finished run in Open3D's viewer.")
    parser.add_argument("run", type=Path, metavar="OUT", help="--out folder of a run")
    options = parser.parse_args(arguments)
    from sgslam.report import RunFolder

    geometries = scene_of(RunFolder.read(options.run))
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UserError(f"no display; 'sgslam view {options.run}' shows the run in a browser")
    from sgslam.cloud_to_model import load_open3d

    load_open3d().visualization.draw_geometries(geometries, window_name=str(options.run))
    return 0


def scene_of(run: "RunFolder") -> list[Any]:
    """The run's map, in the colours of its distances from the model where `export` has written these, its way and its
    walls. Raises UserError where Open3D is missing."""
    from data.trajectory import Trajectory
    from sgslam.cloud_to_model import load_open3d, open3d_scene
    from sgslam.cloud_to_model.files import CLOUD

    o3d = load_open3d()
    positions = Trajectory.read_tum(run.path / "trajectory.tum").positions
    walls = [run.corners(surface) for surface in run.s_graph.wall_surfaces]
    if not (run.path / CLOUD).is_file():
        points, _ = run.map_points(run.config.clouds.map_voxel)
        return open3d_scene(points, positions, walls)
    coloured = o3d.io.read_point_cloud(str(run.path / CLOUD))
    return [coloured, *open3d_scene(positions[:0], positions, walls)[1:]]


if __name__ == "__main__":
    run_command(main)
