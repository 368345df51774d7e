"""What `sgslam anchor` gains for the output of SLAM systems by others, in drives with an IMU.

Each system gets the same scans. Its output is anchored to the plan by the command, as its user would.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from data.common.errors import UserError
from data.scans import Scan, ScanFolder
from data.slam_output.kiss_slam import read_kiss_poses
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.sequences import DriveOptions
from evaluation.harness import Record, Study
from evaluation.metrics.trajectories import error_in_bim, wrong_poses
from evaluation.slam_ablation.kiss_slam import COMMAND, kiss_slam_results
from evaluation.slam_ablation.peers import rko_lio_alone, small_gicp_alone
from evaluation.studies.carried.carriers import ate
from evaluation.studies.carried.other_slam_tables import claims, tables

System = Literal["kiss_slam", "rko_lio", "small_gicp"]
Output = Literal["kiss_slam", "kiss_slam_maps", "rko_lio", "small_gicp"]


class Choice(DriveOptions):
    """Drives of `seconds` by `carrier` with each of `sensors` and a class of `imu` in it, each with all `systems`.
    KISS-SLAM is left out where its command `kiss_slam` is not found."""

    sequences: tuple[str, ...] = ("institute", "office", "fzk-haus", "niedriha")
    carrier: str = "handheld"
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    imu: str = "mid360"
    seconds: PositiveFloat = 100.0
    systems: tuple[System, ...] = ("kiss_slam", "rko_lio", "small_gicp")
    kiss_slam: str = COMMAND


class Run(CarriedCase):
    """A drive with an IMU of a class, and the systems whose output is anchored."""

    imu: str
    systems: tuple[System, ...] = Field(min_length=1)
    kiss_slam: str = COMMAND


class Gain(BaseModel):
    """The output of a system: `alone_m` is its ATE (m) after SE(3) alignment, None for too little motion. Errors (m) of
    all its poses after anchoring, in the BIM frame without alignment, None without an anchor: the RMSE and the largest;
    `wrong` poses are off by more than 0.5 m or 5 degrees."""

    model_config = ConfigDict(frozen=True)

    poses: int
    alone_m: float | None
    anchored: bool
    reason: str
    rmse_m: float | None
    worst_m: float | None
    wrong: int


class Gains(Record):
    """What anchoring gains for each output, and the CPU seconds that the command takes."""

    scans: int
    length_m: float
    found: dict[Output, Gain]
    cpu_s: Annotated[dict[Output, float], "cost"]


def cases(options: Choice) -> list[Run]:
    """Each sensor in each drive."""
    systems = options.systems
    if "kiss_slam" in systems and which(options.kiss_slam) is None:
        print(f"other_slam: no command {options.kiss_slam}; KISS-SLAM is left out", file=sys.stderr)
        systems = tuple(system for system in systems if system != "kiss_slam")
    return [
        Run(
            sequence=spec, seed=seed, carrier=options.carrier, sensor=sensor, imu=options.imu, seconds=options.seconds,
            systems=systems, kiss_slam=options.kiss_slam,
        )
        for sensor, (spec, seed) in product(options.sensors, options.drives())
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Written:
    """What a system wrote: the `path` that the command gets, with the folder of `scans` or None, and its own `poses`,
    stamped at the instants at which they hold."""

    output: Output
    path: Path
    scans: Path | None
    poses: Trajectory


def measure(case: Run, work: Path) -> Gains:
    """Simulates the drive, runs the systems on it, and anchors what they write to the whole building.

    Raises UserError if a system or the command fails.
    """
    found, cpu_s = dict[Output, Gain](), dict[Output, float]()
    with carried(case, work, imu=case.imu) as drive, TemporaryDirectory(prefix="other.", dir=work) as name:
        for system in case.systems:
            for written in RUNS[system](case, drive, Path(name)):
                out = Path(name) / f"{written.output}-anchored"
                metrics = _anchor(written, drive.plan, out)
                anchored = Trajectory.read_tum(out / "trajectory_all.tum")
                found[written.output] = _gain(written.poses, anchored, drive.truth, metrics)
                cpu_s[written.output] = metrics["cpu_seconds"]
        return Gains(scans=drive.count, length_m=drive.length, found=found, cpu_s=cpu_s)


def _kiss_slam(case: Run, drive: CarriedDrive, folder: Path) -> Iterator[Written]:
    """Its folder of results: with the scans, and with its own local maps."""
    results = kiss_slam_results(case.kiss_slam, drive.folder, folder)
    poses = Trajectory(_ends_ns(ScanFolder(drive.folder)), read_kiss_poses(results).poses)
    yield Written("kiss_slam", results, drive.folder, poses)
    yield Written("kiss_slam_maps", results, None, poses)


def _rko_lio(case: Run, drive: CarriedDrive, folder: Path) -> Iterator[Written]:
    yield _as_tum("rko_lio", rko_lio_alone(drive.scans(), drive.samples), drive, folder)


def _small_gicp(case: Run, drive: CarriedDrive, folder: Path) -> Iterator[Written]:
    yield _as_tum("small_gicp", small_gicp_alone(drive.scans()), drive, folder)


RUNS: dict[System, Callable[[Run, CarriedDrive, Path], Iterator[Written]]] = {
    "kiss_slam": _kiss_slam, "rko_lio": _rko_lio, "small_gicp": _small_gicp,
}  # fmt: skip


def _as_tum(output: Output, found: Trajectory, drive: CarriedDrive, folder: Path) -> Written:
    """A TUM file of poses at the ends of scans, stamped there, as RKO-LIO itself writes it."""
    poses, path = Trajectory(_ends_ns(drive.scans()), found.poses), folder / f"{output}.tum"
    poses.write_tum(path)
    return Written(output, path, drive.folder, poses)


def _ends_ns(scans: Iterable[Scan]) -> NDArray[np.int64]:
    """(N,) when the last point of each scan was measured."""
    lasting = [(scan.stamp_ns, 0.0 if scan.point_times is None else scan.point_times.max()) for scan in scans]
    return np.array([stamp_ns + round(1e9 * float(seconds)) for stamp_ns, seconds in lasting], np.int64)


def _anchor(written: Written, plan: Path, out: Path) -> dict[str, Any]:
    """The content of metrics.json, after the command. Raises UserError if it fails."""
    scans = [] if written.scans is None else ["--scans", str(written.scans)]
    command = [sys.executable, "-m", "sgslam.other_slam.anchor", str(written.path), *scans]
    done = subprocess.run(
        [*command, "--bim", str(plan), "--out", str(out)], capture_output=True, text=True, check=False
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        raise UserError(f"{written.path}: sgslam anchor failed: {last}")
    return dict(json.loads((out / "metrics.json").read_text()))


def _gain(alone: Trajectory, anchored: Trajectory, truth: Trajectory, metrics: dict[str, Any]) -> Gain:
    """`anchored` holds all poses of the output; those without stamps of the scans' clock get those of `alone`."""
    if len(anchored) == len(alone):
        anchored = Trajectory(alone.stamps_ns, anchored.poses)
    common = {"poses": len(anchored), "anchored": metrics["anchored"], "reason": metrics["reason"]}
    if not metrics["anchored"]:
        return Gain(**common, alone_m=ate(alone, truth), rmse_m=None, worst_m=None, wrong=0)
    error = error_in_bim(anchored, Trajectory(anchored.stamps_ns, truth.at(anchored.stamps_ns))).position
    return Gain(
        **common, alone_m=ate(alone, truth), rmse_m=error.rmse, worst_m=error.max, wrong=wrong_poses(anchored, truth)
    )  # fmt: skip


QUICK = Choice(seeds=(1,))
STUDY = Study(
    "other_slam", "what `sgslam anchor` gains for the output of SLAM systems by others",
    Choice, QUICK, Run, Gains, cases, measure, tables, claims,
)  # fmt: skip
