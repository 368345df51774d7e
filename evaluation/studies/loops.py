"""Benefit of loop closure without a plan, and the number of false closures.

Drives along identical offices (once along, back and forth, around a ring of corridors) and tours through the storeys of
a list, each with and without loop closure. A closure is false if it is more than 0.5 m or 5 degrees off the truth.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
import pandas as pd

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.drives.loop_drives import ONCE, Drive, Route, drive_along, drive_through
from evaluation.drives.sequences import STOREYS, SequenceSpec, read_specs, select_sequences
from evaluation.harness import Case, Cost, Options, Record, Study
from evaluation.harness.tables import grouped
from evaluation.metrics.trajectories import ape, drift, rpe
from sgslam.config import Config
from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import angle_of, inverse
from sgslam.mapping import Closure
from sgslam.slam import SceneGraphSlam

FrontEnd = Literal["normal", "trusted"]
"""The system as it is; points beyond 6 m dropped, and a degraded external odometry, whose poses are taken as they
are."""
LEVEL = 4  # of the degraded odometry: steps 4 % too long, yaw random walk of 1.2 degrees per square root of a metre
LENGTH = 150.0  # m of a tour
FALSE_M, FALSE_RAD = 0.5, float(np.radians(5.0))


class Choice(Options):
    """Which drives along identical offices, and which tours through storeys of the YAML list `listed`."""

    routes: tuple[Route, ...] = get_args(Route)
    listed: Path = STOREYS
    sequences: tuple[str, ...] = ("institute", "office")
    front_ends: tuple[FrontEnd, ...] = get_args(FrontEnd)
    seeds: tuple[int, ...] = (0, 1, 2)


class Run(Case):
    """A drive with or without `closing` loops: one of the routes, or a tour through the storey."""

    drive: str  # the route, or the name of the storey
    storey: SequenceSpec | None
    front_end: FrontEnd
    seed: int
    closing: bool

    def files(self) -> set[str]:
        """The building, if it has one."""
        return self.storey.files() if self.storey is not None else set()


class Errors(Record):
    """Errors and loop closures of a run.

    `ape_m` is the position error after alignment to the truth; `end_percent` that of the last position with the first
    poses aligned, relative to the path length. `closure_m` is the largest error of a closure, `withdrawn` the number of
    closures that were withdrawn again.
    """

    way_m: float
    ape_m: float
    rpe_1m_m: float
    end_percent: float
    surfaces: int
    rooms: int
    closures: int
    withdrawn: int
    false: int
    closure_m: float | None
    seconds: Cost
    seconds_loops: Cost


def cases(options: Choice) -> list[Run]:
    """The drives with and without loop closure; without only those that come back, since others have nothing to close.

    Raises UserError for sequences that are not simulated from an IFC model.
    """
    drives: dict[str, SequenceSpec | None] = dict.fromkeys(options.routes)
    listed = select_sequences(read_specs(options.listed), options.sequences) if options.sequences else []
    for spec in listed:
        if not spec.simulated or spec.storey is None:
            raise UserError(f"'{spec.name}': needs an IFC model and a storey's name to simulate a drive")
        drives[spec.name] = spec
    return [
        Run(drive=name, storey=spec, front_end=front_end, seed=seed, closing=closing)
        for name, spec in drives.items() for front_end in options.front_ends for seed in options.seeds
        for closing in (True, False) if closing or name not in ONCE
    ]  # fmt: skip


def measure(case: Run, work: Path) -> Errors:
    """Simulates the scans one by one and runs them without a plan."""
    drive = _drive(case)
    slam = SceneGraphSlam(config=Config(loops=LoopSettings(enabled=case.closing)))
    for stamp_ns, points, T_odom_sensor in drive.scans():
        slam.add_scan(stamp_ns, points, T_odom_sensor=T_odom_sensor)
    result = slam.finish()
    estimate, truth, scene = result.trajectory_map, drive.truth, result.s_graph
    withdrawn = [closure for closure, _ in slam.loops.withdrawn]
    errors = errors_of([*slam.loops.closures, *withdrawn], [k.stamp_ns for k in scene.keyframes], truth)
    moved = drift(estimate, truth)
    return Errors(
        way_m=moved.travelled_m, ape_m=_ape(estimate, truth), rpe_1m_m=rpe(estimate, truth).translation.rmse,
        end_percent=moved.end_percent, surfaces=len(scene.wall_surfaces), rooms=len(scene.rooms),
        closures=len(errors), withdrawn=len(withdrawn), closure_m=max((off for off, _ in errors), default=None),
        false=sum(off > FALSE_M or turn > FALSE_RAD for off, turn in errors), seconds=sum(result.seconds.values()),
        seconds_loops=result.seconds["loops"],
    )  # fmt: skip


def _drive(case: Run) -> Drive:
    level = 0 if case.front_end == "normal" else LEVEL
    if case.storey is None:
        return drive_along(cast(Route, case.drive), case.seed, level)
    return drive_through(Path(case.storey.bim), case.storey.storey or "", LENGTH, case.seed, level)


def _ape(estimate: Trajectory, truth: Trajectory) -> float:
    try:
        return ape(estimate, truth, "se3").translation.rmse
    except UserError:  # a straight path does not determine the rotation
        return ape(estimate, truth, "origin").translation.rmse


def errors_of(closures: Iterable[Closure], stamps: list[int], truth: Trajectory) -> list[tuple[float, float]]:
    """The error (m, rad) of each closure's motion; `stamps` (ns) are those of the keyframes."""
    at = dict(zip(truth.stamps_ns.tolist(), truth.poses, strict=True))
    errors = []
    for closure in closures:
        T = inverse(at[stamps[closure.earlier]]) @ at[stamps[closure.later]]
        left = inverse(T) @ closure.T_earlier_later
        errors.append((float(np.linalg.norm(left[:3, 3])), angle_of(left)))
    return errors


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each drive and front end over its seeds, without and with loop closure."""

    def cells(own: pd.DataFrame) -> dict[str, str]:
        """The errors with loop closure beside those without."""
        closed, without = own[own.closing], own[~own.closing]

        def both(name: str, column: str, form: str, factor: float = 1.0) -> dict[str, str]:
            return {f"{name}, {kind}": _mean(runs[column], form, factor)
                    for kind, runs in (("open", without), ("closed", closed))}  # fmt: skip

        return {
            "runs": str(len(closed)), "driven (m)": _mean(own.way_m, ".0f"), **both("APE (m)", "ape_m", ".3f"),
            **both("RPE 1 m (mm)", "rpe_1m_m", ".1f", 1000), **both("end (% of the length)", "end_percent", ".3f"),
            **both("wall surfaces", "surfaces", ".0f"), "closures": str(closed.closures.sum()),
            "withdrawn": str(closed.withdrawn.sum()), "false": str(closed.false.sum()),
            "worst closure (m)": f"{closed.closure_m.max():.3f}" if closed.closure_m.notna().any() else "",
            "time of loops": f"{100 * closed.seconds_loops.sum() / closed.seconds.sum():.1f} %",
        }  # fmt: skip

    return {"drives": grouped(rows.rename(columns={"front_end": "front end"}), ("drive", "front end"), cells)}


def _mean(values: "pd.Series[float]", form: str, factor: float = 1.0) -> str:
    return format(factor * values.mean(), form) if len(values) else ""


STUDY = Study(
    "loops", "what loop closure gains without a plan, and how many closures are false",
    Choice, Choice(routes=("along", "ring"), sequences=(), front_ends=("trusted",), seeds=(0,)),
    Run, Errors, cases, measure, tables,
)  # fmt: skip
