"""What `sgslam anchor` gains for the output of SLAM systems by others; and tracking and anchoring with an IMU, beside
LiDAR-inertial odometries.

Each system gets the same scans. Its output is anchored to the plan by the command, as its user would.
"""

import json
import subprocess
import sys
from collections.abc import Iterable, Mapping
from itertools import product
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan, ScanFolder
from data.slam_output.opening import read_kiss_poses
from data.trajectory import Trajectory
from evaluation.buildings import generated, plan_graph
from evaluation.drive import Drive, DriveCase, DriveOptions, drive_of
from evaluation.outcome import Outcome
from evaluation.peers.odometries import KISS_SLAM, kiss_slam_results
from evaluation.run import described, run, study_of_runs
from evaluation.study import Claim, Record
from evaluation.tables import ANCHORED, EVER_WRONG, Query, count, made, often, spread, spread_of, units
from evaluation.variants import ODOMETRIES

REMOVED = 0.8  # of the other system's error, which anchoring should remove
ANCHOR = "anchor "  # before the name of a system: its output is anchored by the command
OF_KISS_SLAM = ("KISS-SLAM", "KISS-SLAM's maps")  # with the scans, and with its local maps alone
TRACKED, RUN = ("tracking", "tracking with IMU", "RKO-LIO", "GenZ-LIO"), ("anchored", "with IMU")


class Choice(DriveOptions):
    """The `systems` whose output is anchored, and the `inertial` variants, by each of `carriers` with each of `sensors`
    and a class of `imu` in it. KISS-SLAM is left out where its command is not found."""

    buildings: tuple[str, ...] = (
        *("institute", "office", "fzk-haus", "niedriha"),
        *generated(60),
    )
    carriers: tuple[str, ...] = ("handheld", "wheeled")
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    imu: str = "mid360"
    systems: tuple[str, ...] = (*OF_KISS_SLAM, "RKO-LIO", "small_gicp")
    inertial: tuple[str, ...] = (*TRACKED, *RUN)
    seconds: float = 90.0


def cases(options: Choice) -> list[DriveCase]:
    """Each sensor on each carrier in each drive, with all systems and variants."""
    systems = options.systems
    if which(KISS_SLAM) is None:
        print(f"other_slam: no command {KISS_SLAM}; KISS-SLAM is left out", file=sys.stderr)
        systems = tuple(system for system in systems if system not in OF_KISS_SLAM)
    variants = (*(f"{ANCHOR}{system}" for system in systems), *options.inertial)
    return [
        DriveCase(**drive, carrier=carrier, sensor=sensor, imu=options.imu, variant=variant)
        for drive, carrier, sensor in product(options.drives(), options.carriers, options.sensors)
        for variant in variants
    ]


def measure(case: DriveCase, work: Path) -> Record:
    """A run of a variant; or what a system writes, and what the command makes of it.

    Raises UserError if a system or the command fails.
    """
    if not case.variant.startswith(ANCHOR):
        return run(case, work)
    drive, system = drive_of(case, work), case.variant.removeprefix(ANCHOR)
    with TemporaryDirectory(prefix="other.", dir=work) as name:
        path, alone = _output(system, drive, Path(name))
        scans = None if system == OF_KISS_SLAM[1] else drive.folder
        plan = Path(name) / "plan.json"
        plan_graph(drive.plan).save(plan)
        began = process_time()
        metrics = _anchor(path, scans, plan, Path(name) / "anchored")
        anchored = Trajectory.read_tum(Path(name) / "anchored" / "trajectory_all.tum")
    if len(anchored) == len(alone):  # those without stamps of the scans' clock
        anchored = Trajectory(alone.stamps_ns, anchored.poses)
    exact = Trajectory(anchored.stamps_ns, drive.truth.at(anchored.stamps_ns))
    alarms = [name for name, signal in metrics["quality"].items() if not signal["ok"]]
    facts = {"reason": metrics["reason"], "cpu_s": metrics.get("cpu_seconds", process_time() - began)}
    outcome = Outcome(drive.count, exact, odometry=alone, facts={**facts, "alarms": alarms})
    if metrics["anchored"]:
        outcome = Outcome(drive.count, exact, anchored, anchored, alone, facts=outcome.facts)
    measured = described(case) | outcome.measures()
    gained = measured["anchored"] and measured["odometry_ate_m"]
    return measured | {"removed": 1 - measured["rmse_m"] / measured["odometry_ate_m"] if gained else None}


def _output(system: str, drive: Drive, folder: Path) -> tuple[Path, Trajectory]:
    """What a system writes, and its poses at the instants at which they hold, the ends of the scans."""
    ends = _ends_ns(drive.scans())
    if system in OF_KISS_SLAM:
        results = kiss_slam_results(drive.folder, folder)
        return results, Trajectory(_ends_ns(ScanFolder(drive.folder)), read_kiss_poses(results).poses)
    poses = Trajectory(ends, ODOMETRIES[system](drive.scans(), drive.samples).poses)
    poses.write_tum(folder / "poses.tum")
    return folder / "poses.tum", poses


def _ends_ns(scans: Iterable[Scan]) -> NDArray[np.int64]:
    """(N,) when the last point of each scan was measured."""
    lasting = [(scan.stamp_ns, 0.0 if scan.point_times is None else scan.point_times.max()) for scan in scans]
    return np.array([stamp_ns + round(1e9 * float(seconds)) for stamp_ns, seconds in lasting], np.int64)


def _anchor(output: Path, scans: Path | None, plan: Path, out: Path) -> dict[str, Any]:
    """The content of metrics.json, after the command. Raises UserError if it fails."""
    given = [] if scans is None else ["--scans", str(scans)]
    command = [sys.executable, "-m", "sgslam.other_slam.anchor", str(output), *given, "--bim", str(plan)]
    done = subprocess.run([*command, "--out", str(out)], capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        raise UserError(f"{output.name}: sgslam anchor failed: {last}")
    return dict(json.loads((out / "metrics.json").read_text()))


def is_output(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Which rows are of the output of another system."""
    return rows.variant.str.startswith(ANCHOR)


RUNS = {**ANCHORED, **EVER_WRONG}
GAIN = {
    **ANCHORED,
    "alone: ATE (m)": spread("odometry_ate_m", ".3f"),
    "error removed (%)": spread("removed", ".0f", 100),
    "80 % or more": count(lambda rows: rows.removed >= REMOVED),
    **EVER_WRONG,
    "CPU of the command (s)": spread("cpu_s"),
}
TRACKING = {
    "drives": count(),
    "ATE (m)": spread("odometry_ate_m", ".3f"),
    "over a second (m)": spread("second_m", ".3f"),
    "over a second (deg)": spread("second_deg", ".2f"),
    "worst step (m)": spread("worst_step_m", ".2f"),
    "scans a second of CPU": spread("scans_per_s"),
}
BY = {"variant": "variant"}
QUERIES = {
    "gain": Query(BY, GAIN, is_output),
    "tracking": Query(BY, TRACKING, lambda rows: rows.variant.isin(TRACKED)),
    "inertial": Query(BY, RUNS, lambda rows: rows.variant.isin(RUN)),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """What anchoring gains for each output; tracking with an IMU; runs with a plan, with the IMU and without."""
    return made(QUERIES, rows)


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often anchoring removes most of another system's error; tracking with an IMU beside the better of others."""
    outputs = rows[is_output(rows)]
    wide = rows.pivot_table(index="drive", columns="variant", values="odometry_ate_m")
    wide = wide.reindex(columns=[*wide, *({"tracking with IMU", "RKO-LIO", "GenZ-LIO"} - set(wide))])
    ratios = (wide["tracking with IMU"] / wide[["RKO-LIO", "GenZ-LIO"]].min(axis=1)).dropna()
    removed = often(outputs.removed >= REMOVED, outputs.building, "outputs")
    return [
        Claim("Outputs of others of whose error `sgslam anchor` removes 80 % or more", removed, units(outputs)),
        Claim("ATE with an IMU, over the better of RKO-LIO and GenZ-LIO", spread_of(ratios, ".2f"), units(rows)),
    ]


QUICK = Choice(
    buildings=("institute", "fzk-haus", *generated(60)[:3]),
    carriers=("handheld",),
    sensors=("VLP-16",),
    seconds=30.0,
)
STUDY = study_of_runs(
    "other_slam",
    "what `sgslam anchor` gains for the output of SLAM systems by others, and what an IMU gains",
    QUICK,
    cases,
    tables,
    claims,
    measure=measure,
)
