"""`python -m sgslam.run --scan-dir DIR --bim FILE`: scans and a building's model in, an anchored trajectory out."""

import argparse
import gc
import logging
import math
import sys
from datetime import datetime
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

from data.cli import Parser, run_command
from data.errors import UserError

if TYPE_CHECKING:

    from data.scene_graph import SceneGraph
    from data.trajectory import Trajectory


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, also when nothing could be anchored. Raises UserError."""
    options = _parser().parse_args(arguments)
    if options.resume is None and options.scan_dir is None and not options.demo:
        raise UserError("--scan-dir is missing: give the folder that holds the scans, or --demo")
    # libraries are loaded only now, so that --help and a missing argument answer at once
    from threadpoolctl import threadpool_limits

    from data.bcf import Model
    from data.bim import load_bim
    from data.scan_sources import open_scans
    from data.trajectory import Trajectory
    from sgslam.accuracy import associate
    from sgslam.checkpoints import Checkpoints, load
    from sgslam.config import Config
    from sgslam.export import BCF
    from sgslam.feeding import Progress, feed
    from sgslam.findings import write_topics
    from sgslam.keyframe_clouds import FILE as CLOUDS
    from sgslam.keyframe_clouds import KeyframeClouds
    from sgslam.known_map import KnownMap
    from sgslam.live_view import LiveView, open_page
    from sgslam.odometry_choice import choose
    from sgslam.output import prepare_folder, save_result
    from sgslam.resuming import take_up, told_by
    from sgslam.run_inputs import check_same, inputs_of
    from sgslam.settings import load_config
    from sgslam.slam import SceneGraphSlam

    threadpool_limits(1, user_api="blas")  # a scan is small: more threads only wait for each other
    page = None if options.view is None else open_page(options.view)
    before = None if options.resume is None else take_up(options)
    if before is None or options.config is not None or options.set:
        config = load_config(options.config, options.set)
    else:
        config = Config.model_validate(before["config"])
    given = None
    if options.odometry is not None:
        config, given = choose(options.odometry, config)
    start = None if options.start is None else _start(options.start)
    matcher = _matcher(config.matching.method, start)
    if options.demo:
        _make_demo(options)
    earlier = None
    if options.map is not None:
        if options.out is not None and options.out.resolve() == options.map.resolve():
            raise UserError(f"--map {options.map}: is the --out folder too; give another --out")
        earlier = KnownMap.load(options.map, config)
        plan = options.map / "a_graph.json"
        if options.bim is None and earlier.T_bim_map is not None and plan.is_file():
            options.bim = plan  # the building that the map is anchored to
    if options.bim is None and (options.storey is not None or options.start is not None):
        raise UserError("--storey and --start say where in the building; give --bim too")
    scans = open_scans(options.scan_dir, options.topic)
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    known = scans.stamps_ns  # a bag's are not, before it is read
    if truth is not None and known is not None and not len(associate(known, truth.stamps_ns)[0]):
        raise UserError(f"{options.ground_truth}: no stamp is near a scan's; give the truth by the scans' clock")
    if given is not None and known is not None:
        given.check(known)
    began, used = perf_counter(), process_time()
    bim = None if options.bim is None else load_bim(options.bim, layers=options.layer)
    seconds = {"bim": perf_counter() - began}
    a_graph = None if bim is None else bim.graph
    if a_graph is not None:
        _check_storey(a_graph, options.storey)
    out = prepare_folder(options.out or _dated_folder())
    told = {"storey": options.storey, "start": start, "topic": options.topic}
    inputs = inputs_of(scans, a_graph, config, told, options.map)
    if before is not None:
        check_same(out, before, inputs)
    _log_to(out / "run.log", options.verbose, anew=before is None)
    for notice in [scans.note, *(bim.notices if bim is not None else ())]:
        if notice:
            logging.getLogger("sgslam").warning("%s", notice)
    if before is None:
        clouds = KeyframeClouds(out / CLOUDS, config.clouds.keyframe_voxel)
    else:
        clouds = KeyframeClouds.open(out / CLOUDS, before["keyframes"], config.clouds.keyframe_voxel)
    slam = SceneGraphSlam(a_graph, matcher, config, clouds=clouds, known=earlier, storey=options.storey)
    progress = Progress() if before is None else Progress(**load(out, slam))
    checkpoints = Checkpoints(out, {**inputs, "arguments": told_by(options)})
    if before is None:
        checkpoints.write(slam, progress.to_dict())  # what an earlier run left there is none of this one's
    log = logging.getLogger("sgslam")
    log.info("%d scans in %s; building: %s", len(scans), scans.path, options.bim or "none")
    gc.freeze()  # what is loaded now stays: it need not be searched for garbage again and again
    view = None if page is None else LiveView(page, a_graph, truth)
    broken = feed(slam, scans, progress, checkpoints, given, None if view is None else view.tell)
    seconds |= progress.seconds
    for skipped in scans.skipped:
        log.warning("%s is skipped: %s", skipped.name, skipped.reason)
    for remark in scans.remarks:
        log.warning("%s", remark)
    result = slam.finish()
    seconds["total"], cpu_seconds = perf_counter() - began, process_time() - used
    log.info("%s: %s", "anchored" if result.anchored else "not anchored", result.reason)
    for kind, count in result.factors.counts().items():
        log.info("factors, %s: %s", kind, ", ".join(f"{number} {what}" for what, number in count.items()))
    more: dict[str, Any] = {"scans_skipped": len(scans.skipped), "seconds": {**result.seconds, **seconds}}
    more["cpu_seconds"] = cpu_seconds  # of all threads together
    more["told"] = {"storey": options.storey, "start": start}
    if truth is not None:
        more["accuracy"] = _accuracy(result, truth)
    metrics = save_result(result, out, a_graph=None if bim is None else bim.graph, truth=truth, more=more)
    if bim is not None and result.T_bim_map is not None:
        write_topics(
            out / BCF, result.deviations, bim.graph, result.s_graph, result.T_bim_map, Model(options.bim.name)
        )  # fmt: skip
    if broken is not None:
        how = f"; 'python -m sgslam.run --resume {out}' goes on" if broken.startswith("interrupted") else ""
        raise UserError(f"{broken}; what was computed up to there is in {out}{how}")
    checkpoints.write(slam, progress.to_dict(), finished=True)
    _show(metrics, out)
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


def _dated_folder() -> Path:
    return Path("out") / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")


def _make_demo(options: argparse.Namespace) -> None:
    """Writes the demo building and a simulated drive into the out folder, and points the options at them."""
    from data.bim import load_bim
    from data.demo_building import DEMO_STOREYS, write_demo_building
    from data.simulate import simulate
    from sgslam.output import prepare_folder

    if options.scan_dir is not None or options.bim is not None:
        raise UserError("--demo brings its own scans and building; leave --scan-dir and --bim out")
    options.out = prepare_folder(options.out or _dated_folder())
    options.bim = options.out / "demo_building.ifc"
    drive = options.out / "demo_drive"
    if drive.exists():
        raise UserError(f"{options.out}: holds a demo already; give another --out")
    print(f"demo: writing a building of two storeys, {options.bim}")
    write_demo_building(options.bim)
    _check_storey(load_bim(options.bim).graph, options.storey)  # a wrong name is told before the drive
    names = " and ".join(f"'{name}'" for name in DEMO_STOREYS)
    print(f"demo: driving through its {names} with a simulated LiDAR, {drive}")
    simulate(options.bim, DEMO_STOREYS, drive, seed=options.seed, min_rooms=4, min_length=30.0)
    options.scan_dir, options.ground_truth = drive / "scans", drive / "truth.tum"
    print("demo: now the main job, with nothing known but scans and building")


def _start(text: str) -> tuple[float, float, float]:
    try:
        x, y, yaw = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"--start {text}: not of the form X,Y,YAW, such as 3.5,-1.2,1.57") from None
    if not all(math.isfinite(value) for value in (x, y, yaw)):
        raise UserError(f"--start {text}: not finite numbers")
    return x, y, yaw


def _check_storey(a_graph: "SceneGraph", name: str | None) -> None:
    """Raises UserError for the name of a storey that there is not."""
    from sgslam.storey_hypotheses import floor_named

    if name is not None:
        try:
            floor_named(a_graph, name)
        except UserError as error:
            raise UserError(f"--{error}") from None


def _matcher(method: str, start: tuple[float, float, float] | None) -> Any:
    from matching import Matcher

    try:
        matcher = Matcher.load(method)
    except UserError as error:
        raise UserError(f"setting matching.method: {error}") from None
    return matcher if start is None else _StartedMatcher(matcher, start)


class _StartedMatcher:
    """A matcher that is told roughly where the map begins."""

    def __init__(self, matcher: Any, start: tuple[float, float, float]) -> None:
        self._matcher, self._start = matcher, start

    def match(self, s: "SceneGraph", a: "SceneGraph") -> Any:
        return self._matcher.match(s, a, start=self._start)


def _accuracy(result: Any, truth: "Trajectory") -> dict[str, Any]:
    from sgslam.accuracy import accuracy

    return accuracy(result.trajectory if result.anchored else None, result.trajectory_odometry, truth)


def _log_to(path: Path, verbose: bool, anew: bool) -> None:
    logging.raiseExceptions = False  # where the disk is full, the run goes on without its log
    logger = logging.getLogger("sgslam")
    logger.setLevel(logging.DEBUG if verbose else logging.INFO)
    screen = logging.StreamHandler(sys.stderr)
    screen.setLevel(logging.DEBUG if verbose else logging.WARNING)
    screen.setFormatter(logging.Formatter("%(message)s"))
    file = logging.FileHandler(path, mode="w" if anew else "a")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logger.handlers = [screen, file]


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
