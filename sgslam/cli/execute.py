"""Executes what the options of a run describe, in one process or in two, and prints a summary of the results."""

import multiprocessing
import os
import sys
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser
from sgslam.cli.options import OF_A_RUN, RunOptions, add_options

if TYPE_CHECKING:
    from sgslam.viewer.live import LiveView

NOT_ENOUGH = 3  # exit code
_MOST_WAITING = 100  # scans, of up to a megabyte each, that wait for the map


def run_parser() -> Parser:
    """The parser of `sgslam run`."""
    about = "Estimate the trajectory of a LiDAR in building coordinates from its scans and the building's plan."
    parser = Parser(prog="python -m sgslam.run", description=about)
    add_options(parser, *OF_A_RUN)
    return parser


def execute(options: RunOptions) -> int:
    """Returns 0 when done, even if nothing could be anchored, and 3 if that is not enough for `--strict`. Raises
    UserError."""
    # imported only now, so that --help and a missing argument respond at once
    from sgslam.cli.processes.mapping_process import MappingProcess

    mapping = MappingProcess(_MOST_WAITING) if _has_two_processes(options) else None  # loads what it needs meanwhile
    from sgslam.cli.processes.tracking_side import run_in_two_processes, settle_threads

    settle_threads()
    if mapping is None:
        metrics, out, shown = _in_one_process(options)
    else:
        (metrics, out), shown = run_in_two_processes(options, mapping), None
    _print_summary(metrics, out)
    if shown is not None:
        shown.show_finished(out)
    lack = _what_lacks(metrics) if options.strict else ""
    if lack:
        print(f"--strict: exit code {NOT_ENOUGH}: {lack}", file=sys.stderr)
    return NOT_ENOUGH if lack else 0


def _has_two_processes(options: RunOptions) -> bool:
    """Whether tracking gets a process of its own: on two cores or more, where nothing watches the map grow."""
    is_one_of_many = multiprocessing.parent_process() is not None  # as in a batch of runs
    is_caught = sys.stderr is not sys.__stderr__  # by a program, which the other process's lines would pass by
    is_watched = options.view is not None or options.rerun is not None
    return len(os.sched_getaffinity(0)) > 1 and not (is_watched or is_one_of_many or is_caught)


def _in_one_process(options: RunOptions) -> tuple[dict[str, Any], Path, "LiveView | None"]:
    """The content of metrics.json, the folder, and the page that showed the run, if one did."""
    from sgslam.cli.job.inputs import RunInputs
    from sgslam.cli.job.run import Run, run_scans
    from sgslam.result.saving import prepare_folder
    from sgslam.viewer.live import LiveView
    from sgslam.viewer.page import Page, parse_address
    from sgslam.viewer.rerun_log import RerunLog

    page = None if options.view is None else Page(parse_address(options.view))
    if page is not None:
        print(f"view: {page.url}", flush=True)
    inputs = RunInputs.read(options)
    building = inputs.read_building()
    plan = None if building.bim is None else building.bim.graph
    out = prepare_folder(inputs.out)
    with nullcontext() if options.rerun is None else closing(RerunLog(options.rerun, plan)) as log:
        run = Run(inputs, building)
        view = None if page is None else LiveView(page, plan, building.truth)
        watchers = [watcher.add_scan for watcher in (view, log) if watcher is not None]
        metrics = run.finish(run_scans(run.slam, inputs, run.progress, run.save, watchers))
        if log is not None:
            log.add_map(run.slam)
    return metrics, out, view


def _what_lacks(metrics: dict[str, Any]) -> str:
    """Why the run is not anchored in every scan and sound in every signal of quality; empty if it is."""
    from sgslam.report.tables import badge

    lacks = [] if metrics["anchored_share"] == 1.0 else [badge(metrics)]
    if not all(signal["ok"] for signal in metrics["quality"].values()):
        lacks.append(_quality(metrics["quality"]))
    return "; ".join(lacks)


def _print_summary(metrics: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from sgslam.report import tables

    table = Table(show_header=False, title=tables.badge(metrics))
    floors = "1 floor" if metrics["floors"] == 1 else f"{metrics['floors']} floors"
    seconds = metrics["seconds"]
    stages = ", ".join(f"{name} {value:.1f}" for name, value in seconds.items() if name not in ("total", "report"))
    quality = ", but ".join(filter(None, (_quality(metrics["quality"]), tables.doubt(metrics))))
    rows = {"Reason": metrics["reason"], "Quality of the map": quality}
    rows |= tables.run_rows(metrics)
    rows["Map"] = f"{floors}, {metrics['rooms']} rooms, {metrics['wall_surfaces']} wall surfaces"
    rows["Time"] = f"{stages}, total {seconds['total']:.1f} s (without the report)"
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
