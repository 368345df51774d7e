"""Our odometry, KISS-ICP, small_gicp and an external odometry, alone and in runs.

Alone: as a run uses it, without a map or a plan. The external odometry is KISS-ICP on whole
scans, with its own best settings. Computing times are relative to KISS-ICP's own pipeline on the same drive.
"""

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from time import process_time
from typing import Literal

import pandas as pd

from data.scans import Scan, ScanFolder
from data.trajectory import Trajectory
from evaluation.drives import Sequence, prepare
from evaluation.drives.conditions import NORMAL
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveCase, DriveOptions, odometry_of_run
from evaluation.harness import Claim, Cost, Record, Study
from evaluation.harness.tables import coverage, each, grouped, interval
from evaluation.metrics.bootstrap import ratio
from evaluation.metrics.consistency import nees
from evaluation.metrics.trajectories import ape, error_in_bim, rpe
from evaluation.slam_ablation.peers import cpu_seconds_of_kiss_icp, kiss_icp_alone
from matching import Matcher
from matching.self_test import make_ready
from sgslam.config import Config, OdometrySettings
from sgslam.odometry.external import ExternalOdometry
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

ODOMETRIES = {"continuous_time": "ours", "kiss": "KISS-ICP", "small_gicp": "small_gicp", "external": "external"}
RPE_M = 1.0
WARM_UP = 20  # scans that are run first, so that libraries and compiled loops are loaded before time counts
WRONG_M = 0.5  # RMSE above which an anchored run counts as anchored to a wrong place
Name = Literal["continuous_time", "kiss", "small_gicp", "external"]


class Choice(DriveOptions):
    """The drives and the odometries."""

    sequences: tuple[str, ...] = ("demo", "institute")
    odometries: tuple[Name, ...] = ("continuous_time", "kiss", "small_gicp", "external")


class Run(DriveCase):
    """A drive with one odometry."""

    odometry: Name


class Errors(Record):
    """`alone_*` are the odometry's relative error over a metre and its absolute error after SE(3) alignment (m);
    `rmse_m` and `max_m` those of the run in the BIM frame, over the share `coverage` of the scans.
    `cpu_*` are CPU seconds, reading the scans included;
    `cpu_kiss` are those of KISS-ICP's own pipeline on the same drive."""

    alone_rpe_m: float
    alone_ape_m: float
    anchored: bool
    rmse_m: float | None
    max_m: float | None
    nees_per_dof: float | None
    cpu_alone: Cost
    cpu_run: Cost
    cpu_kiss: Cost
    coverage: float | None = None


def cases(options: Choice) -> list[Run]:
    """Each drive with all odometries."""
    return [
        Run(sequence=spec, seed=seed, odometry=name)
        for spec, seed in options.drives() for name in options.odometries
    ]  # fmt: skip


def measure(case: Run, work: Path) -> Errors:
    """Runs the odometry alone, and the system with it; the drive is simulated if it is missing."""
    sequence = prepare(case.sequence, case.seed, work, NORMAL)
    scans = ScanFolder(sequence.scan_dir)
    make_ready(Matcher.load(), Config().matching.method)
    _run(case.odometry, sequence, list(islice(scans, WARM_UP)))
    alone, result, cpu_alone, cpu_run = _run(case.odometry, sequence, scans)
    error = error_in_bim(result.trajectory, sequence.truth) if result.anchored else None
    known = result.pose_covariances
    return Errors(
        alone_rpe_m=rpe(alone, sequence.truth, RPE_M).translation.rmse,
        alone_ape_m=ape(alone, sequence.truth, "se3").translation.rmse,
        anchored=result.anchored, rmse_m=None if error is None else error.position.rmse,
        max_m=None if error is None else error.position.max,
        coverage=None if error is None else error.matched_poses / len(scans),
        nees_per_dof=None if known is None else nees(known.trajectory, sequence.truth, known.covariances),
        cpu_alone=cpu_alone, cpu_run=cpu_run, cpu_kiss=cpu_seconds_of_kiss_icp(sequence.scan_dir),
    )  # fmt: skip


def _run(name: Name, sequence: Sequence, scans: Iterable[Scan]) -> tuple[Trajectory, Result, float, float]:
    """The odometry alone, the run with it, and the CPU seconds of both."""
    config = Config() if name == "external" else Config(odometry=OdometrySettings(method=name))
    began = process_time()
    alone = kiss_icp_alone(scans) if name == "external" else odometry_of_run(scans, config)
    ended = process_time()
    slam = SceneGraphSlam(sequence.a_graph, config=config)
    result = run_through(slam, scans, ExternalOdometry(alone) if name == "external" else None)
    return alone, result, ended - began, process_time() - ended


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each sequence and odometry, over its seeds."""

    def cells(own: pd.DataFrame) -> dict[str, str]:
        """The errors, the consistency and the time of runs with one odometry."""
        external = own.odometry.iloc[0] == "external"
        return {
            "drives": str(len(own)), "alone: RPE over 1 m (m)": f"{own.alone_rpe_m.mean():.3f}",
            "alone: APE (m)": f"{own.alone_ape_m.mean():.3f}", "anchored": str(own.anchored.sum()),
            "wrong": str((own.rmse_m > WRONG_M).sum()), "RMSE in the BIM frame (m)": each(own.rmse_m, ".4f"),
            "coverage": coverage(own),
            "largest error (m)": each(own.max_m), "NEES per dof": each(own.nees_per_dof, ".2f"),
            "alone, times KISS-ICP": "" if external else f"{(own.cpu_alone / own.cpu_kiss).median():.2f}",
            "whole run, times KISS-ICP": f"{(own.cpu_run / own.cpu_kiss).median():.2f}",
        }  # fmt: skip

    table = grouped(rows, ["sequence.name", "odometry"], cells).rename(columns={"sequence.name": "sequence"})
    return {"odometries": table.assign(odometry=table.odometry.map(ODOMETRIES))}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How much the error depends on the odometry."""
    anchored, drive = rows.dropna(subset="rmse_m"), ["sequence.name", "seed"]
    kiss, other = (anchored[anchored.odometry == name] for name in ("kiss", "small_gicp"))
    both = other.merge(kiss, on=drive, suffixes=("", "_kiss"))
    if both.empty:
        return []
    relative = ratio(both.rmse_m, both.rmse_m_kiss, both["sequence.bim"].tolist())
    cases = f"{len(both)} drives, {both['sequence.bim'].nunique()} buildings"
    return [Claim("RMSE of anchored runs with small_gicp, relative to KISS-ICP", interval(relative, ".2f"), cases)]


QUICK = Choice(sequences=("demo",), seeds=(0,), odometries=("continuous_time", "kiss", "small_gicp"))
STUDY = Study(
    "odometries", "how much the accuracy, the consistency and the time of a run depend on the odometry",
    Choice, QUICK, Run, Errors, cases, measure, tables, claims, timed=True,
)  # fmt: skip
