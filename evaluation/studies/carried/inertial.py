"""How well each scan's pose is tracked with an IMU: ours with and without, and LiDAR-inertial odometries alone.

Each method gets the same scans, with their points' times, and the same samples.
"""

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from pathlib import Path
from time import process_time
from typing import Annotated, Literal

import pandas as pd
from pydantic import Field, PositiveFloat

from data.imu import ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, carried
from evaluation.drives.runs import tracked_by_run
from evaluation.drives.sequences import DriveOptions
from evaluation.harness import Record, Study
from evaluation.harness.tables import each, grouped, spread
from evaluation.slam_ablation.peers import genz_lio_alone, rko_lio_alone
from evaluation.studies.carried.carriers import WARM_UP, Errors, Found, errors_of
from evaluation.studies.carried.carriers_tables import named
from sgslam.config import Config

Method = Literal["sgslam", "sgslam_imu", "rko_lio", "genz_lio"]
LABELS = {"sgslam": "sgslam", "sgslam_imu": "sgslam with the IMU", "rko_lio": "RKO-LIO", "genz_lio": "GenZ-LIO"}


class Choice(DriveOptions):
    """Drives of `seconds` by each of `carriers`, with each of `sensors` and each class of `imus` in it."""

    sequences: tuple[str, ...] = ("demo", "institute", "office", "basement")
    carriers: tuple[str, ...] = ("wheeled", "handheld", "pole")
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    imus: tuple[str, ...] = ("mid360", "tactical")
    seconds: PositiveFloat = 60.0
    methods: tuple[Method, ...] = ("sgslam", "sgslam_imu", "rko_lio", "genz_lio")


class Run(CarriedCase):
    """A drive with an IMU of a class, and the methods that track it."""

    imu: str
    methods: tuple[Method, ...] = Field(min_length=1)


class Tracking(Record):
    """The number of scans, and by method the errors and the scans tracked in a second of CPU time."""

    scans: int
    found: dict[Method, Errors]
    scans_per_s: Annotated[dict[Method, float], "cost"]


def cases(options: Choice) -> list[Run]:
    """Every combination, in each drive."""
    cells = product(options.carriers, options.sensors, options.imus)
    return [
        Run(
            sequence=spec, seed=seed, carrier=carrier, sensor=sensor, imu=imu, seconds=options.seconds,
            methods=options.methods,
        )
        for carrier, sensor, imu in cells for spec, seed in options.drives()
    ]  # fmt: skip


def measure(case: Run, work: Path) -> Tracking:
    """Simulates the drive and tracks it by each method. Raises UserError if a method's library is missing."""
    found, scans_per_s = dict[Method, Errors](), dict[Method, float]()
    with carried(case, work, imu=case.imu) as drive:
        for method in case.methods:
            track = METHODS[method]
            track(drive.scans(WARM_UP), drive.samples)
            began = process_time()
            poses = track(drive.scans(), drive.samples)
            scans_per_s[method] = drive.count / (process_time() - began)
            found[method] = errors_of(Found(poses), drive, (0.0 if method.startswith("sgslam") else 1.0,))
    return Tracking(scans=drive.count, found=found, scans_per_s=scans_per_s)


def _sgslam(scans: Iterable[Scan], samples: ImuSamples) -> Trajectory:
    """Our tracker, as a run without a plan uses it, without the IMU."""
    return tracked_by_run(scans, Config()).poses


def _sgslam_imu(scans: Iterable[Scan], samples: ImuSamples) -> Trajectory:
    """The same with it."""
    return tracked_by_run(scans, Config(), samples).poses


METHODS: dict[Method, Callable[[Iterable[Scan], ImuSamples], Trajectory]] = {
    "sgslam": _sgslam, "sgslam_imu": _sgslam_imu, "rko_lio": rko_lio_alone, "genz_lio": genz_lio_alone,
}  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The ATE of each method, seed by seed, and all errors by method."""
    rows = named(rows)
    by = ["sequence.name", "carrier", "sensor", "imu", "seconds"]
    ate = grouped(rows, by, _ate).rename(columns={"sequence.name": "building"})
    known = [method for method in LABELS if f"found.{method}.second_m" in rows]
    errors = pd.DataFrame([{"method": LABELS[method], **_errors(rows, method)} for method in known])
    return {"ate": ate, "errors": errors}


def _ate(own: pd.DataFrame) -> dict[str, str]:
    columns = {label: f"found.{method}.ate_m" for method, label in LABELS.items()}
    return {f"{label}: ATE (m)": each(own[name]) for label, name in columns.items() if name in own}


def _errors(rows: pd.DataFrame, method: str) -> dict[str, str]:
    def of(field: str) -> "pd.Series[float]":
        return rows[f"found.{method}.{field}"]

    return {
        "drives": str(of("second_m").notna().sum()), "ATE (m)": spread(of("ate_m"), ".3f"),
        "in a second (m)": spread(of("second_m"), ".3f"), "in a second (degrees)": spread(of("second_deg"), ".2f"),
        "worst step (m)": spread(of("worst_step_m"), ".2f"), "scans a second": spread(rows[f"scans_per_s.{method}"]),
    }  # fmt: skip


QUICK = Choice(sequences=("demo", "office"), seeds=(0,), carriers=("handheld",), imus=("mid360",), seconds=35.0)
STUDY = Study(
    "inertial", "how well each scan is tracked with an IMU, by ours and by LiDAR-inertial odometries",
    Choice, QUICK, Run, Tracking, cases, measure, tables, small=True, apart="methods",
)  # fmt: skip
