"""Benefit of loop closure without a plan, and the number of false closures.

    python -m evaluation.studies.loops --out DIR

Drives along identical offices (once along, back and forth, around a ring of corridors) and tours through the storeys of
a list, each with and without loop closure. A closure is false if it is more than 0.5 m or 5 degrees off the truth. The
CSV has a line for each run; lines that exist already are skipped.
"""

import argparse
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from data.trajectory import Trajectory
from evaluation.harness import SequenceSpec, read_records, read_specs, select_sequences, write_records
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.drives.loop_drives import ONCE, ROUTES, Drive, drive_along, drive_through
from evaluation.harness.record_file import Record
from evaluation.metrics.trajectories import ape, drift, rpe
from sgslam.config import Config, TrackingSettings
from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import inverse
from sgslam.mapping import Closure
from sgslam.slam import SceneGraphSlam

FRONT_ENDS = {
    "normal": "the system as it is",
    "weak": "points beyond 6 m dropped, a degraded external odometry, each scan aligned to the walls",
    "trusted": "the same without aligning the scans to the walls",
}
LEVEL = 4  # of the degraded odometry: steps 4 % too long, yaw random walk of 1.2 degrees per square root of a metre
LENGTH = 150.0  # m of a tour
FALSE_M, FALSE_RAD = 0.5, float(np.radians(5.0))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run.

    `ape_m` is the position error after alignment to the truth; `end_m` the error of the last position with the first
    poses aligned, `end_percent` relative to the path length. `closure_m` is the largest error of a closure, `withdrawn`
    the number of closures that were withdrawn again.
    """

    drive: str
    front_end: str
    seed: int
    loops: bool
    way_m: float
    ape_m: float
    rpe_1m_m: float
    end_m: float
    end_percent: float
    surfaces: int
    rooms: int
    closures: int
    withdrawn: int
    false: int
    closure_m: float | None
    seconds: float
    seconds_loops: float


COLUMNS = tuple(f.name for f in fields(Row))
_KEY = ("drive", "front_end", "seed", "loops")


def measure(
    routes: list[str], specs: list[SequenceSpec], front_ends: list[str], seeds: list[int], out: Path
) -> list[Record]:
    """Runs what `out`/loops.csv lacks; returns all requested records.

    Raises UserError for sequences that are not simulated, and as the simulator does.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "loops.csv"
    records, requested = read_records(path, COLUMNS), set()
    for name in (*routes, *(spec.name for spec in specs)):
        for front_end, seed, loops in ((f, s, on) for f in front_ends for s in seeds for on in (True, False)):
            if not loops and name in ONCE:  # there is nothing to close
                continue
            key = (name, front_end, str(seed), str(loops))
            requested.add(key)
            if any(_key(r) == key for r in records):
                continue
            spec = next((spec for spec in specs if spec.name == name), None)
            drive = _drive(name, spec, seed, 0 if front_end == "normal" else LEVEL)
            records.append(_record(_row(drive, name, front_end, loops)))
            write_records(path, COLUMNS, records)
            print(_short(records[-1]), flush=True)
    return [r for r in records if _key(r) in requested]


def _drive(route: str, spec: SequenceSpec | None, seed: int, level: int) -> Drive:
    if spec is None:
        return drive_along(route, seed, level)
    if not spec.simulated or spec.storey is None:
        raise UserError(f"'{spec.name}': needs an IFC model and a storey's name to simulate a drive")
    return drive_through(Path(spec.bim), spec.storey, LENGTH, seed, level)


def _row(drive: Drive, name: str, front_end: str, loops: bool) -> Row:
    config = Config(loops=LoopSettings(enabled=loops), tracking=TrackingSettings(correct=front_end != "trusted"))
    slam = SceneGraphSlam(config=config)
    for stamp_ns, points, T_odom_sensor in drive.scans():
        slam.add_scan(stamp_ns, points, T_odom_sensor=T_odom_sensor)
    result = slam.finish()
    estimate, truth = result.trajectory_map, drive.truth
    stamps = [k.stamp_ns for k in result.s_graph.keyframes]
    given_up = [closure for closure, _ in slam.loops.withdrawn]
    errors = errors_of([*slam.loops.closures, *given_up], stamps, truth)
    moved = drift(estimate, truth)
    return Row(
        drive=name, front_end=front_end, seed=drive.seed, loops=loops, way_m=moved.travelled_m,
        ape_m=_ape(estimate, truth), rpe_1m_m=rpe(estimate, truth).translation.rmse,
        end_m=moved.end_percent / 100 * moved.travelled_m, end_percent=moved.end_percent,
        surfaces=len(result.s_graph.wall_surfaces), rooms=len(result.s_graph.rooms), closures=len(errors),
        withdrawn=len(given_up), false=sum(off > FALSE_M or turn > FALSE_RAD for off, turn in errors),
        closure_m=max((off for off, _ in errors), default=None), seconds=sum(result.seconds.values()),
        seconds_loops=result.seconds["loops"],
    )  # fmt: skip


def _ape(estimate: Trajectory, truth: Trajectory) -> float:
    try:
        return ape(estimate, truth, "se3").translation.rmse
    except UserError:  # a straight path does not determine the rotation
        return ape(estimate, truth, "origin").translation.rmse


def errors_of(closures: Iterable[Closure], stamps: list[int], truth: Trajectory) -> list[tuple[float, float]]:
    """The error (m, rad) of each closure's motion; `stamps` (ns) are those of the keyframes."""
    at = {stamp: pose for stamp, pose in zip(truth.stamps_ns.tolist(), truth.poses, strict=True)}
    errors = []
    for closure in closures:
        T = inverse(at[stamps[closure.earlier]]) @ at[stamps[closure.later]]
        left = inverse(T) @ closure.T_earlier_later
        turn = float(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1.0, 1.0)))
        errors.append((float(np.linalg.norm(left[:3, 3])), turn))
    return errors


def table(records: list[Record]) -> str:
    """Markdown table: a line for each drive and front end over its seeds, without and with loop closure."""
    head = ("drive", "front end", "runs", "way (m)", "APE (m), open", "closed", "RPE 1 m (mm), open", "closed",
            "end (% of the way), open", "closed", "wall surfaces, open", "closed", "closures", "withdrawn", "false",
            "worst closure (m)", "time of loops")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    groups: dict[tuple[str, str], list[Record]] = {}
    for r in records:
        groups.setdefault((r["drive"], r["front_end"]), []).append(r)
    for (drive, front_end), own in groups.items():
        without, closed = ([r for r in own if r["loops"] == on] for on in ("False", "True"))
        worst = [float(r["closure_m"]) for r in closed if r["closure_m"]]
        spent = sum(float(r["seconds_loops"]) for r in closed) / max(sum(float(r["seconds"]) for r in closed), 1e-9)
        lines.append("| " + " | ".join([
            drive, front_end, str(len(closed)), _mean(own, "way_m", ".0f"),
            _mean(without, "ape_m", ".3f"), _mean(closed, "ape_m", ".3f"),
            _mean(without, "rpe_1m_m", ".1f", 1000), _mean(closed, "rpe_1m_m", ".1f", 1000),
            _mean(without, "end_percent", ".3f"), _mean(closed, "end_percent", ".3f"),
            _mean(without, "surfaces", ".0f"), _mean(closed, "surfaces", ".0f"),
            *(str(sum(int(r[column]) for r in closed)) for column in ("closures", "withdrawn", "false")),
            f"{max(worst):.3f}" if worst else "", f"{spent:.1%}",
        ]) + " |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _mean(records: list[Record], column: str, form: str, scale: float = 1.0) -> str:
    return format(scale * float(np.mean([float(r[column]) for r in records])), form) if records else ""


def _short(r: Record) -> str:
    closed = f"{r['closures']} closures, {r['false']} false" if r["loops"] == "True" else "open"
    where = f"{r['drive']} {r['front_end']} seed {r['seed']}, {closed}"
    return f"{where}: APE {float(r['ape_m']):.3f} m, end {float(r['end_m']):.3f} m"


def _key(record: Record) -> tuple[str, ...]:
    return tuple(record[column] for column in _KEY)


def _record(row: Row) -> Record:
    return {name: "" if (value := getattr(row, name)) is None else str(value) for name in COLUMNS}


def _parser() -> argparse.ArgumentParser:
    about = "Measure runs without a plan, with and without loop closure."
    parser = Parser(prog="python -m evaluation.studies.loops", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for loops.csv and loops.md")
    add("--routes", nargs="*", default=list(ROUTES), choices=ROUTES, metavar="NAME",
        help=f"drives along identical offices ({', '.join(ROUTES)}; default all)")  # fmt: skip
    add("--list", type=Path, metavar="FILE", help="YAML list of further storeys to drive through")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--front-ends", nargs="+", default=list(FRONT_ENDS), choices=FRONT_ENDS, metavar="NAME",
        help=f"{', '.join(FRONT_ENDS)} (default all)")  # fmt: skip
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'loops' is written")
    return parser


def main() -> int:
    """The command line."""
    options = _parser().parse_args()
    specs = select_sequences([] if options.list is None else read_specs(options.list), options.sequences)
    text = table(measure(options.routes, specs, options.front_ends, options.seeds, options.out))
    write_atomically(options.out / "loops.md", f"# Loops\n\n{text}")
    if options.benchmarks is not None:
        command = f"python -m evaluation.studies.loops --out {options.out.name} --benchmarks {options.benchmarks.name}"
        section = f"## Loops\n\n{_ABOUT}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "loops", section)
    print(text)
    return 0


_ABOUT = (
    "No plan is given. Drives: "
    + "; ".join(f"{name}: {about}" for name, about in ROUTES.items())
    + f"; others: a tour of {LENGTH:g} m through rooms and corridors and back to its start. Front ends: "
    + "; ".join(f"{name}: {about}" for name, about in FRONT_ENDS.items())
    + f". The degraded odometry's steps are {LEVEL} % too long, its yaw has a random walk of {0.3 * LEVEL:.1f} degrees "
    "per square root of a metre. APE is over positions, aligned to the truth (a straight path by its first pose). A "
    f"closure is false if it is more than {FALSE_M:g} m or {np.degrees(FALSE_RAD):.0f} degrees off the truth; "
    "withdrawn ones count."
)


if __name__ == "__main__":
    run_command(main)
