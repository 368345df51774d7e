"""The options of `sgslam live`."""

import argparse
from pathlib import Path

from data.common.cli import Parser
from data.common.errors import UserError
from sgslam.config import Config

DEFAULT_WAITING = 600  # scans


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    from sgslam.run import add_options

    about = (
        "Track scans as they arrive and print a line of JSON for each; a second process builds the map and anchors it. "
        "Lines 'initialpose X Y YAW' on standard input give the sensor's present pose (m, rad), if SOURCE is a folder."
    )
    made = Parser(prog="python -m sgslam.live", description=about)
    add = made.add_argument
    add("source", metavar="SOURCE", help="folder into which scans are written, or - for MCAP records on standard input")
    add_options(made, live=True)
    add("--odometry", metavar="NAME", help="continuous_time (default), kiss or small_gicp")
    add("--idle", type=float, metavar="S", help="end after so many seconds without a scan (default: at Ctrl-C)")
    add(
        "--most-waiting",
        type=int,
        default=DEFAULT_WAITING,
        metavar="N",
        help=f"maximum number of scans that wait for the map; then tracking waits (default {DEFAULT_WAITING})",
    )
    return made


def checked_config(options: argparse.Namespace) -> Config:
    """The settings that the options give; the folder for the results is made. Raises UserError for wrong options."""
    from sgslam.cli.job.arguments import out_folder, read_config, read_start

    if options.odometry is not None and Path(options.odometry).is_file():
        raise UserError(f"--odometry {options.odometry}: live runs take no poses from a file; name an odometry")
    if options.idle is not None and not options.idle > 0:
        raise UserError(f"--idle {options.idle:g}: give more than 0 seconds")
    if options.most_waiting < 1:
        raise UserError(f"--most-waiting {options.most_waiting}: give 1 or more")
    config, _ = read_config(options)
    if options.start is not None:
        read_start(options.start)
    options.out = out_folder(options)
    return config
