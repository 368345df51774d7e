"""The options of `sgslam live`."""

import argparse
from pathlib import Path

from data.common.cli import Parser
from data.common.errors import UserError
from sgslam.live.messages import LiveInputs

DEFAULT_WAITING = 600  # scans


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    from sgslam.run import add_options

    about = (
        "Track scans as they come, one line of JSON for each; map and anchors follow in a second process. Lines "
        "'initialpose X Y YAW' on standard input say where the sensor is now (m, rad)."
    )
    made = Parser(prog="python -m sgslam.live", description=about)
    add = made.add_argument
    add("source", metavar="SOURCE", help="folder into which scans are written, or - for MCAP records on standard input")
    add_options(made, live=True)
    add("--odometry", metavar="NAME", help="continuous_time (default), kiss, small_gicp")
    add("--idle", type=float, metavar="S", help="end when no scan has come for so many seconds (default: at Ctrl-C)")
    add(
        "--most-waiting",
        type=int,
        default=DEFAULT_WAITING,
        metavar="N",
        help=f"scans that may wait for the map; then tracking waits (default {DEFAULT_WAITING})",
    )
    return made


def inputs_of(options: argparse.Namespace) -> LiveInputs:
    """The inputs that the options name. Raises UserError."""
    from sgslam.cli.job.arguments import out_folder, read_config, read_start

    if options.odometry is not None and Path(options.odometry).is_file():
        raise UserError(f"--odometry {options.odometry}: live, poses cannot come from a file; give the name of one")
    if options.idle is not None and not options.idle > 0:
        raise UserError(f"--idle {options.idle:g}: give seconds, more than 0")
    if options.most_waiting < 1:
        raise UserError(f"--most-waiting {options.most_waiting}: give 1 or more")
    config, _ = read_config(options)
    start = None if options.start is None else read_start(options.start)
    return LiveInputs(
        out_folder(options), config, options.bim, tuple(options.layer), options.map, options.storey, start,
        options.ground_truth, options.verbose,
    )  # fmt: skip
