"""`python -m sgslam.live SOURCE --bim FILE`: scans as they come, a line of JSON for each. `sgslam live` is the same."""

import gc
import logging
import sys
from pathlib import Path
from typing import Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from sgslam.cli.options import COMMON, RunOptions, add_options, bounded


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 once the results are written. Raises UserError."""
    given = _parser().parse_args(arguments)
    options = RunOptions.of(given)
    if options.odometry is not None and Path(options.odometry).is_file():
        raise UserError(f"--odometry {options.odometry}: live runs take no poses from a file; name an odometry")
    # imported only now, so that --help and a missing argument respond at once
    from data.streams import GrowingFolder
    from sgslam.cli.job.inputs import default_out, read_settings
    from sgslam.cli.job.run import Interruption
    from sgslam.cli.processes.tracking_side import settle_threads
    from sgslam.live.live_slam import LiveSlam
    from sgslam.live.loop import LiveLoop
    from sgslam.result.saving import prepare_folder

    config, _ = read_settings(options)
    if given.source == "-":
        raise UserError("-: MCAP on standard input is no longer read; give a folder, or use sgslam.LiveSlam")
    stream = GrowingFolder(given.source)
    stream.stamped = config.tracking.stamp
    out = prepare_folder(options.out or default_out())
    settle_threads()
    logging.getLogger("sgslam").setLevel(logging.INFO)
    with Interruption() as interruption:
        place: dict[str, Any] = {"storey": options.storey, "start": options.start, "map": options.map}
        live = LiveSlam(out, options.bim, config=config, **place, more=options)
        gc.freeze()  # what is loaded stays: the garbage collector need not scan it
        loop = LiveLoop(live, stream, sys.stdout, given.idle, lambda: bool(interruption))
        print(f"ready; results will be in {out}", file=sys.stderr)
        fault = loop.run()
    print(f"{live.waiting} scans still wait for the map; then the results are written", file=sys.stderr)
    metrics = live.finish(stream.skipped, stream.remarks)
    print(_summary(metrics, out), file=sys.stderr)
    if fault is not None:
        raise UserError(f"{fault}; the results so far are in {out}")
    return 0


def _parser() -> Parser:
    about = "Track scans as they arrive and print a line of JSON for each; a second process builds and anchors the map."
    parser = Parser(prog="python -m sgslam.live", description=about)
    add = parser.add_argument
    add("source", metavar="SOURCE", help="folder into which scans are written")
    odometry = {"metavar": "NAME", "help": "continuous_time (default), kiss or small_gicp"}
    add_options(parser, *COMMON, odometry=odometry)
    idle = "end after so many seconds without a scan (default: at Ctrl-C)"
    add("--idle", type=bounded("--idle", float, 1e-3, " seconds"), metavar="S", help=idle)
    return parser


def _summary(metrics: dict[str, Any], out: Path) -> str:
    told = metrics["live"]
    where = "anchored" if metrics["anchored"] else "not anchored"
    times = f"{told['p50_ms']} ms (median; 99 %: {told['p99_ms']}, longest: {told['longest_ms']})"
    return (
        f"{where}: {metrics['reason']}\n{told['answers']} scans, answered within {times}; "
        f"at most {told['most_waiting']} waited for the map\nreport: {out / 'report.html'}"
    )


if __name__ == "__main__":
    run_command(main)
