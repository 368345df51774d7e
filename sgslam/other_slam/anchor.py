"""`python -m sgslam.other_slam.anchor OUTPUT --bim FILE`: another SLAM's finished output in, anchored poses out.

OUTPUT is a file of poses (TUM, KITTI's poses, EuRoC's CSV), KISS-SLAM's folder of results, GLIM's dump, or a pose graph
(`.g2o`) with a cloud for each vertex.
"""

import argparse
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError

_GRAPH = ".g2o"
# a finished trajectory is taken as it is, also where its poses are metres apart
_POSES_AS_GIVEN = "odometry.outlier_speed=1e6"
_REGISTERED = "odometry.given=measured"  # the scans themselves tell the motion from one to the next better
_EACH_A_KEYFRAME = "keyframes.scans=1"  # each scan made of a map shows a part of it that no other shows


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, even if nothing could be anchored, and 3 if that is not enough for `--strict`.
    Raises UserError."""
    options = _parser().parse_args(arguments)
    if not options.slam_output.exists():
        raise UserError(f"{options.slam_output}: no such file or folder; give the output of a SLAM system")
    if options.bim is None:
        raise UserError("--bim is missing; give the plan to which the poses are to be anchored")
    if options.slam_output.suffix.lower() == _GRAPH and options.scan_dir is None:
        without = f"{options.slam_output}: a graph without clouds is no longer anchored by this command"
        raise UserError(f"{without}; give --scans, or see examples/anchor_s_graphs.py")
    from sgslam.run import execute

    settings = [_POSES_AS_GIVEN]
    settings.append(_EACH_A_KEYFRAME if options.scan_dir is None else _REGISTERED)
    options.set = [*settings, *options.set]
    return execute(options)


def _parser() -> argparse.ArgumentParser:
    from sgslam.run import add_options

    about = "Anchor the finished output of another SLAM system to a building's plan (--bim, required)."
    parser = Parser(prog="python -m sgslam.other_slam.anchor", description=about)
    add = parser.add_argument
    add("slam_output", type=Path, metavar="OUTPUT",
        help="poses (TUM, KITTI, EuRoC), a folder of KISS-SLAM or GLIM, or a .g2o file")  # fmt: skip
    add("--scans", dest="scan_dir", type=Path, metavar="DIR", help="scans, or one cloud per pose: a folder or a bag")
    add("--cloud", type=Path, metavar="FILE", help="map in the poses' frame, instead of scans: .ply, .pcd, .las, ...")
    add("--times", type=Path, metavar="FILE", help="stamps of the KITTI poses, in seconds, one per line")
    add("--single-pass", action="store_true", default=None, help="do not register the scans a second time")
    add_options(parser)
    parser.set_defaults(odometry=None, imu=None, imu_topic=None, resume=None, demo=False, seed=0)
    return parser


if __name__ == "__main__":
    run_command(main)
