"""`python -m sgslam.run --scan-dir DIR --bim FILE`: scans and a building's model in, an anchored trajectory out."""

import argparse
import gc
import sys
from pathlib import Path
from typing import Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, also when nothing could be anchored. Raises UserError."""
    options = _parser().parse_args(arguments)
    if options.resume is None and options.scan_dir is None and not options.demo:
        raise UserError("--scan-dir is missing: give the folder that holds the scans, or --demo")
    # libraries are loaded only now, so that --help and a missing argument answer at once
    from threadpoolctl import threadpool_limits

    from sgslam.cli.run_job import Run, out_folder, read_job
    from sgslam.cli.scan_loop import feed
    from sgslam.viewer.live import LiveView, open_page

    threadpool_limits(1, user_api="blas")  # a scan is small: more threads only wait for each other
    sys.setswitchinterval(1e-4)  # the thread that reads ahead gives way at once; by the default it holds the run up
    page = None if options.view is None else open_page(options.view)
    job = read_job(options)
    out = out_folder(options)
    run = Run(job, out)
    gc.freeze()  # what is loaded now stays: it need not be searched for garbage again and again
    view = None if page is None else LiveView(page, job.a_graph, job.truth)
    onlooker = None if view is None else view.tell
    broken = feed(run.slam, job.scans, run.progress, run.checkpoints, job.given, onlooker)
    _show(run.finish(broken), out)
    if view is not None:
        view.stay(out)
    return 0


def _parser() -> argparse.ArgumentParser:
    about = "Scans and a building's IFC file in, a trajectory in building coordinates out."
    parser = Parser(prog="python -m sgslam.run", description=about)
    add = parser.add_argument
    add("--scan-dir", type=Path, metavar="DIR", help="folder of scans, or a bag; the formats: docs/formats.md")
    add("--topic", metavar="NAME", help="the scans' topic in a bag, where it holds several")
    add("--bim", type=Path, metavar="FILE", help="the building: .ifc, .ifczip, .dxf, .geojson, or an A-graph as .json")
    add("--layer", action="append", default=[], metavar="NAME", help="a layer of a .dxf with walls; may be given again")
    add("--map", type=Path, metavar="DIR", help="the --out folder of an earlier run, whose map this one goes on with")
    add("--out", type=Path, metavar="DIR", help="where the results go (default: out/<date>)")
    add("--ground-truth", type=Path, metavar="FILE", help="sensor poses in the BIM frame, TUM, the scans' clock")
    add("--start", metavar="X,Y,YAW", help="rough start in the BIM frame, metres and radians; breaks ties")
    add("--storey", metavar="NAME", help="the storey where the run begins, where it is known")
    add("--odometry", metavar="NAME|FILE", help="kiss (the default), small_gicp, or a TUM file of T_odom_sensor")
    add("--config", type=Path, metavar="FILE", help="settings as YAML, such as a run's config.yaml")
    add("--set", action="append", default=[], metavar="A.B=C", help="one setting; may be given again")
    add("--resume", type=Path, metavar="DIR", help="go on with the run of that --out folder, which was broken off")
    add("--demo", action="store_true", help="make a building, drive through it, and run on that; needs nothing else")
    add("--seed", type=int, default=0, metavar="N", help="of the demo's drive")
    add("--view", nargs="?", const="8080", metavar="[HOST:]PORT", help="show the run in the browser, until Ctrl-C")
    add("--verbose", action="store_true", help="tell what happens")
    return parser


def _show(metrics: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, title="anchored" if metrics["anchored"] else "not anchored")
    rows = {"reason": metrics["reason"]}
    rows["scans"] = f"{metrics['scans']} ({metrics['scans_skipped']} skipped), {metrics['keyframes']} keyframes"
    rows["map"] = f"{metrics['rooms']} rooms, {metrics['wall_surfaces']} wall surfaces"
    if (returned := metrics["returned"]) is not None:
        found = f"found in it after {returned['found_s']:.1f} s" if returned["found"] else "not found in it"
        rows["earlier map"] = f"{found}: {returned['reason']}"
    if metrics["first_anchor_s"] is not None:
        rows["first anchor"] = f"{metrics['first_anchor_s']:.1f} s after the start"
    for name, value in metrics.get("accuracy", {}).items():
        if value is not None:
            rows[name] = f"{value:.4f}" if isinstance(value, float) else str(value)
    rows["time"] = ", ".join(f"{name} {value:.1f}" for name, value in metrics["seconds"].items()) + " s"
    for name, value in rows.items():
        table.add_row(name, value)
    Console().print(table)
    print(f"report: {out / 'report.html'}")


if __name__ == "__main__":
    run_command(main)
