"""`python -m sgslam.run --scan-dir DIR --bim FILE`: scans and a building's model in, an anchored trajectory out."""

import argparse
import gc
import multiprocessing
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    from sgslam.viewer.live import LiveView

NOT_ENOUGH = 3  # exit code
_MOST_WAITING = 100  # scans, of up to a megabyte each, that wait for the map


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, even if nothing could be anchored, and 3 if that is not enough for `--strict`.
    Raises UserError."""
    options = _parser().parse_args(arguments)
    if options.resume is None and options.scan_dir is None and not options.demo:
        raise UserError("--scan-dir is missing; give the folder that holds the scans, or --demo")
    return execute(options)


def execute(options: argparse.Namespace) -> int:
    """The run that the options describe; returns as `main` does. Raises UserError."""
    # imported only now, so that --help and a missing argument respond at once
    from sgslam.cli.processes.mapping_process import MappingProcess

    mapping = MappingProcess(_MOST_WAITING) if _has_two_processes(options) else None  # loads what it needs meanwhile
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, user_api="blas")  # a scan is small: more threads would only wait for each other
    sys.setswitchinterval(1e-4)  # with the default interval the reading thread slows the run down
    if mapping is None:
        metrics, shown = _in_one_process(options)
    else:
        from sgslam.cli.processes.batch_run import run_in_two_processes

        metrics, shown = run_in_two_processes(options, mapping), None
    _print_summary(metrics, options.out)
    if shown is not None:
        shown.show_finished(options.out)
    lack = _what_lacks(metrics) if options.strict else ""
    if lack:
        print(f"--strict: exit code {NOT_ENOUGH}: {lack}", file=sys.stderr)
    return NOT_ENOUGH if lack else 0


def _has_two_processes(options: argparse.Namespace) -> bool:
    """Whether tracking gets a process of its own: on two cores or more, where nothing watches the map grow."""
    is_one_of_many = multiprocessing.parent_process() is not None  # as in a batch of runs
    is_caught = sys.stderr is not sys.__stderr__  # by a program, which the other process's lines would pass by
    is_watched = options.view is not None or options.rerun is not None
    return len(os.sched_getaffinity(0)) > 1 and not (is_watched or is_one_of_many or is_caught)


def _in_one_process(options: argparse.Namespace) -> tuple[dict[str, Any], "LiveView | None"]:
    """The content of metrics.json, and the page that showed the run, if one did."""
    from sgslam.cli.job.arguments import out_folder
    from sgslam.cli.job.inputs import read_job
    from sgslam.cli.job.run import Run
    from sgslam.cli.job.scan_inputs import read_scan_inputs
    from sgslam.cli.job.scan_loop import run_scans
    from sgslam.viewer.live import LiveView, open_page
    from sgslam.viewer.rerun_log import recorded

    page = None if options.view is None else open_page(options.view)
    inputs = read_scan_inputs(options)
    job = read_job(options, inputs)
    options.out = out_folder(options)
    with recorded(options.rerun, job.a_graph) as log:
        run = Run(job, options.out)
        gc.freeze()  # the modules stay loaded: the garbage collector need not scan them
        view = None if page is None else LiveView(page, job.a_graph, job.truth)
        watchers = [watcher.add_scan for watcher in (view, log) if watcher is not None]
        stopped = run_scans(
            run.slam, inputs.scans, run.progress, run.checkpoints, inputs.external_odometry, watchers, inputs.imu
        )
        metrics = run.finish(stopped)
        if log is not None:
            log.add_map(run.slam)
    return metrics, view


def _what_lacks(metrics: dict[str, Any]) -> str:
    """Why the run is not anchored in every scan and sound in every signal of quality; empty if it is."""
    from sgslam.report.tables import badge

    lacks = [] if metrics["anchored_share"] == 1.0 else [badge(metrics)]
    if not all(signal["ok"] for signal in metrics["quality"].values()):
        lacks.append(_quality(metrics["quality"]))
    return "; ".join(lacks)


def _parser() -> argparse.ArgumentParser:
    about = "Estimate the trajectory of a LiDAR in building coordinates from its scans and the building's plan."
    parser = Parser(prog="python -m sgslam.run", description=about)
    add = parser.add_argument
    add("--scan-dir", type=Path, metavar="DIR",
        help="scans: a folder or a bag (docs/own_sensor.md); required without --demo or --resume")  # fmt: skip
    add_options(parser)
    names = "continuous_time (default), kiss or small_gicp"
    add("--odometry", metavar="NAME|FILE", help=f"{names}, or a TUM file with poses")
    add("--imu", type=Path, metavar="FILE", help="IMU samples: a bag, or CSV in the format of EuRoC")
    add("--imu-topic", metavar="NAME", help="topic of the IMU, if the bag of --imu has several")
    add("--resume", type=Path, metavar="DIR", help="--out folder of an interrupted run to resume")
    add("--demo", action="store_true", help="generate a building, simulate a drive through it, and run on this drive")
    add("--seed", type=int, default=0, metavar="N", help="random seed of the demo drive (default: 0)")
    add("--single-pass", action="store_true", default=None, help="do not register all scans a second time")
    parser.set_defaults(slam_output=None, cloud=None, times=None)  # see sgslam.other_slam.anchor
    return parser


def default_options() -> argparse.Namespace:
    """The options of a run of which none was given."""
    return _parser().parse_args([])


def add_options(parser: argparse.ArgumentParser, live: bool = False) -> None:
    """Adds the options of all commands that run on a building; of a `live` run those that it takes."""
    add = parser.add_argument
    add("--topic", metavar="NAME", help="topic of the scans, if there are several")
    add("--bim", type=Path, metavar="FILE", help="the building: .ifc, .ifczip, .dxf, .geojson, or an A-graph as .json")
    add("--layer", action="append", default=[], metavar="NAME", help="wall layer of a .dxf file (repeatable)")
    add("--map", type=Path, metavar="DIR", help="--out folder of an earlier run, whose map this run extends")
    add("--out", type=Path, metavar="DIR", help="folder for the results (default: out/<date>_<time>)")
    add("--ground-truth", type=Path, metavar="FILE",
        help="true sensor poses in the BIM frame: TUM, with the clock of the scans")  # fmt: skip
    add("--start", metavar="X,Y,YAW", help="rough initial pose in the BIM frame (m, rad); resolves ambiguous matches")
    add("--storey", metavar="NAME", help="name or id of the storey on which the run begins, if known")
    add("--stamp", choices=("start", "middle", "end"),
        help="the instant of a scan that its stamp names (default: what the format fixes, else start)")  # fmt: skip
    add("--mount", metavar="R,P,Y",
        help="roll, pitch and yaw of the sensor in degrees; needed beyond 40 (upside down: 180,0,0)")  # fmt: skip
    add("--tolerance", metavar="LENGTH",
        help="offset up to which an element counts as planned, e.g. 15mm (default: 30mm)")  # fmt: skip
    add("--config", type=Path, metavar="FILE", help="settings as YAML, such as a run's config.yaml")
    add("--set", action="append", default=[], metavar="A.B=C", help="a single setting (repeatable)")
    add("--verbose", action="store_true", help="print log messages")
    if live:
        return
    add("--view", nargs="?", const="8080", metavar="[HOST:]PORT",
        help="show the run in the browser until Ctrl-C (default port: 8080)")  # fmt: skip
    add("--rerun", type=Path, metavar="FILE", help="write a recording (.rrd) for the Rerun viewer")
    add("--strict", action="store_true", help="exit with code 3 unless every scan is anchored and the map is sound")


def _print_summary(metrics: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from sgslam.report.tables import accuracy_rows, badge, known_rows, place_rows, relocalised, stages_and_total

    table = Table(show_header=False, title=badge(metrics))
    rows = {"reason": metrics["reason"], "quality of the map": _quality(metrics["quality"])}
    rows |= dict(place_rows(metrics)) | dict(known_rows(metrics))
    rows["scans"] = f"{metrics['scans']} ({metrics['scans_skipped']} skipped), {metrics['keyframes']} keyframes"
    rows["tracking"] = ", ".join(f"{count} {health}" for health, count in metrics["tracked"].items())
    floors = "1 floor" if metrics["floors"] == 1 else f"{metrics['floors']} floors"
    rows["map"] = f"{floors}, {metrics['rooms']} rooms, {metrics['wall_surfaces']} wall surfaces"
    if (outcome := metrics["returned"]) is not None:
        rows["relocalisation"] = relocalised(outcome)
    if metrics["first_anchor_s"] is not None:
        rows["first anchor"] = f"{metrics['first_anchor_s']:.1f} s after the start"
    rows |= dict(accuracy_rows(metrics.get("accuracy", {})))
    times = ", ".join(f"{name} {value:.1f}" for name, value in stages_and_total(metrics).items())
    rows["time"] = f"{times} s (without the report)"
    for name, value in rows.items():
        table.add_row(name, value)
    Console().print(table)
    print(f"report: {out / 'report.html'}")


def _quality(signals: dict[str, Any]) -> str:
    """The signals that are out of their limits."""
    from sgslam.report.number_formats import signal_texts

    told = [signal_texts(name, own) for name, own in signals.items() if not own["ok"]]
    out = [f"{phrase}: {value} ({limit})" for phrase, value, limit in told]
    return ("outside their limits: " + "; ".join(out)) if out else "all signals within their limits"


if __name__ == "__main__":
    run_command(main)
