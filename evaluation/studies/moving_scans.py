"""Effect of motion distortion, and of registration in continuous time, on fast drives.

Each drive is simulated twice: with instantaneous scans, and with the sensor moving during each revolution. The
difference in error is due to the motion. Without times all scans count as snapshots: they are not guessed here.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import pandas as pd

from data.generation.demo_building import DEMO_STOREY
from data.plans import load_bim
from data.scans import ScanFolder
from data.simulation import Robot
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from evaluation.drives.sequences import demo_building, locked
from evaluation.harness import Case, Options, Record, Study
from evaluation.harness.tables import each, grouped
from evaluation.metrics.trajectories import error_in_bim
from sgslam.config import Config, TrackingSettings
from sgslam.slam import SceneGraphSlam

ROBOTS = {
    "quick": Robot(speed=1.5, acceleration=1.0, yaw_rate=1.2, yaw_acceleration=1.5),
    "hasty": Robot(speed=2.0, acceleration=1.5, yaw_rate=1.8, yaw_acceleration=3.0),
}
Scans = Literal["snapshots", "moving, as they are", "moving, deskewed"]


class Choice(Options):
    """Which drives through the demo building, with which scans."""

    drives: tuple[Literal["quick", "hasty"], ...] = ("quick", "hasty")
    seeds: tuple[int, ...] = (0, 1, 2)
    scans: tuple[Scans, ...] = ("snapshots", "moving, as they are", "moving, deskewed")


class Drive(Case):
    """A drive and how its scans are taken and treated."""

    drive: Literal["quick", "hasty"]
    seed: int
    scans: Scans


class Errors(Record):
    """Whether the run was anchored, and its errors in the BIM frame (m)."""

    poses: int
    anchored: bool
    rmse_m: float | None
    max_m: float | None


def cases(options: Choice) -> list[Drive]:
    """The drives, each with all kinds of scans."""
    return [
        Drive(drive=drive, seed=seed, scans=scans)
        for drive in options.drives for seed in options.seeds for scans in options.scans
    ]  # fmt: skip


def measure(case: Drive, work: Path) -> Errors:
    """Simulates the drive if it is missing, and runs it with the demo building's plan."""
    bim, rolling = demo_building(work), case.scans != "snapshots"
    folder = work / f"{case.drive}-{case.seed}{'-moving' if rolling else ''}"
    with locked(folder):
        if not folder.exists():
            simulate(
                bim, DEMO_STOREY, folder, seed=case.seed, min_rooms=6, min_length=50.0, robot=ROBOTS[case.drive],
                scan_format="ply", effects=("rolling",) if rolling else (),
            )  # fmt: skip
    truth, config = Trajectory.read_tum(folder / "truth.tum"), Config(tracking=TrackingSettings(point_times="snapshot"))
    slam = SceneGraphSlam(load_bim(bim), config=config)
    for scan in ScanFolder(folder / "scans"):
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times if case.scans == "moving, deskewed" else None)
    result = slam.finish()
    error = error_in_bim(result.trajectory, truth).position if result.anchored else None
    return Errors(
        poses=len(truth), anchored=result.anchored, rmse_m=None if error is None else error.rmse,
        max_m=None if error is None else error.max,
    )  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each kind of drive and of scans, over its seeds."""

    def cells(own: pd.DataFrame) -> dict[str, str]:
        return {
            "anchored": f"{own.anchored.sum()}/{len(own)}", "RMSE (m)": each(own.rmse_m, ".4f"),
            "largest error (m)": each(own.max_m),
        }  # fmt: skip

    return {"errors": grouped(rows, ("drive", "scans"), cells)}


STUDY = Study(
    "moving_scans", "how much the sensor's motion within a scan costs, and deskewing saves, in fast drives",
    Choice, Choice(drives=("hasty",), seeds=(0,)), Drive, Errors, cases, measure, tables,
)  # fmt: skip
