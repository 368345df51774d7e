"""`python -m sgslam.other_slam.anchor OUTPUT --bim FILE`: another SLAM's finished output in, anchored poses out.

OUTPUT is a file of poses (TUM, KITTI's poses), KISS-SLAM's folder of results, or a pose graph
(`.g2o`) with a cloud for each vertex.
"""

from dataclasses import replace

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from sgslam.cli.execute import execute
from sgslam.cli.options import ANCHORING, RunOptions, add_options

_GRAPH = ".g2o"
# a finished trajectory is taken as it is, also where its poses are metres apart
_POSES_AS_GIVEN = "odometry.outlier_speed=1e6"
_REGISTERED = "odometry.given=measured"  # the scans themselves tell the motion from one to the next better
_EACH_A_KEYFRAME = "keyframes.scans=1"  # each scan made of a map shows a part of it that no other shows


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, even if nothing could be anchored, and 3 if that is not enough for `--strict`.
    Raises UserError."""
    about = "Anchor the finished output of another SLAM system to a building's plan (--bim, required)."
    parser = Parser(prog="python -m sgslam.other_slam.anchor", description=about)
    scans = {"flag": "--scans", "help": "scans, or one cloud per pose: a folder or a bag"}
    add_options(parser, *ANCHORING, "cloud", "times", slam_output={"flag": "slam_output"}, scan_dir=scans)
    given = parser.parse_args(arguments)
    if not given.slam_output.exists():
        raise UserError(f"{given.slam_output}: no such file or folder; give the output of a SLAM system")
    if given.bim is None:
        raise UserError("--bim is missing; give the plan to which the poses are to be anchored")
    if given.slam_output.suffix.lower() == _GRAPH and given.scan_dir is None:
        without = f"{given.slam_output}: a graph without clouds is no longer anchored by this command"
        raise UserError(f"{without}; give --scans, or see examples/anchor_s_graphs.py")
    options = RunOptions.of(given)
    settings = (_POSES_AS_GIVEN, _EACH_A_KEYFRAME if options.scan_dir is None else _REGISTERED)
    return execute(replace(options, set=(*settings, *options.set)))


if __name__ == "__main__":
    run_command(main)
