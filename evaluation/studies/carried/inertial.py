"""How well each scan's pose is tracked with an IMU, by ours with and without it and by LiDAR-inertial odometries alone;
and how well runs with a plan are anchored, at the recorded pace of a hand and faster.

Each method gets the same scans, with their points' times, and the same samples.
"""

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from pathlib import Path
from time import process_time
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat
from scipy.spatial.transform import Rotation

from data.imu import ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.runs import tracked_by_run
from evaluation.drives.sequences import DriveOptions, plan_of
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import coverage, grouped, of, spread
from evaluation.slam_ablation.peers import genz_lio_alone, rko_lio_alone
from evaluation.studies.carried.anchored_carriers import LEVEL_CARRIER, Anchored, run_with_plan
from evaluation.studies.carried.carriers import RECORDING, WARM_UP, Errors, Found, errors_of
from evaluation.studies.carried.carriers_tables import named
from sgslam.config import Config

Method = Literal["sgslam", "sgslam_imu", "rko_lio", "genz_lio"]
Ours = Literal["sgslam", "sgslam_imu"]
LABELS = {"sgslam": "sgslam", "sgslam_imu": "sgslam with the IMU", "rko_lio": "RKO-LIO", "genz_lio": "GenZ-LIO"}
PEERS = ("rko_lio", "genz_lio")


class Choice(DriveOptions):
    """Drives of `seconds` by each of `carriers`, with each of `sensors` and each class of `imus` in it. A recorded
    motion is played at each of `paces`, for so much shorter. Each drive is tracked by the `methods`, and run with a
    plan by those of ours in `anchored`."""

    sequences: tuple[str, ...] = ("demo", "institute", "office", "basement")
    carriers: tuple[str, ...] = (LEVEL_CARRIER, "handheld", "pole", RECORDING)
    paces: tuple[PositiveFloat, ...] = (1.0, 2.0, 4.0)
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    imus: tuple[str, ...] = ("mid360", "tactical")
    seconds: PositiveFloat = 130.0
    methods: tuple[Method, ...] = ("sgslam", "sgslam_imu", "rko_lio", "genz_lio")
    anchored: tuple[Ours, ...] = ("sgslam", "sgslam_imu")


class Run(CarriedCase):
    """A drive with an IMU of a class, the methods that track it, and those of ours that are run with a plan."""

    imu: str
    methods: tuple[Method, ...] = Field(min_length=1)
    anchored: tuple[Ours, ...] = ()


class Tracking(Record):
    """The number of scans, and by method the errors and the scans tracked in a second of CPU time; by method the runs
    with a plan. `turn_deg_s` is the rate of turn from scan to scan below which it is for 95 % of the drive, and
    `fastest_deg_s` the largest."""

    scans: int
    turn_deg_s: float
    fastest_deg_s: float
    found: dict[Method, Errors]
    scans_per_s: Annotated[dict[Method, float], "cost"]
    with_plan: dict[Ours, Anchored]


def cases(options: Choice) -> list[Run]:
    """Every combination, in each drive."""
    played = [
        (carrier, pace) for carrier in options.carriers
        for pace in (options.paces if carrier.endswith(".tum") else (1.0,))
    ]  # fmt: skip
    cells = product(played, options.sensors, options.imus)
    return [
        Run(
            sequence=spec, seed=seed, carrier=carrier, pace=pace, sensor=sensor, imu=imu,
            seconds=options.seconds / pace, methods=options.methods, anchored=options.anchored,
        )
        for (carrier, pace), sensor, imu in cells for spec, seed in options.drives()
    ]  # fmt: skip


def measure(case: Run, work: Path) -> Tracking:
    """Simulates the drive, tracks it by each method, and runs it with the whole building as its plan.

    Raises UserError if a method's library is missing.
    """
    plan = plan_of(case.sequence, work)
    found, scans_per_s = dict[Method, Errors](), dict[Method, float]()
    with carried(case, work, imu=case.imu) as drive:
        for method in case.methods:
            track = METHODS[method]
            track(drive.scans(WARM_UP), drive.samples)
            began = process_time()
            poses = track(drive.scans(), drive.samples)
            scans_per_s[method] = drive.count / (process_time() - began)
            found[method] = errors_of(Found(poses), drive, (0.0 if method.startswith("sgslam") else 1.0,))
        with_plan = {
            method: run_with_plan(drive, plan, drive.samples if method == "sgslam_imu" else None)
            for method in case.anchored
        }
        turns = _rates_of_turn(drive)
        return Tracking(
            scans=drive.count, turn_deg_s=float(np.percentile(turns, 95)), fastest_deg_s=float(turns.max()),
            found=found, scans_per_s=scans_per_s, with_plan=with_plan,
        )  # fmt: skip


def _rates_of_turn(drive: CarriedDrive) -> NDArray[np.float64]:
    """(N,) degrees a second from each scan to the next."""
    attitudes = Rotation.from_matrix(drive.truth.poses[: drive.count, :3, :3])
    return np.asarray(np.degrees((attitudes[:-1].inv() * attitudes[1:]).magnitude()) / drive.period_s)


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
    """The ATE of each method by carrier, pace and sensor; all errors by method; and the runs with a plan, beside those
    of the robot in the same building."""
    rows = named(rows)
    by = ["carrier", "sensor", "imu"]
    known = [method for method in LABELS if f"found.{method}.second_m" in rows]
    errors = pd.DataFrame([{"method": LABELS[method], **_errors(rows, method)} for method in known])
    made = {"ate": grouped(rows, by, _ate), "errors": errors}
    ours = [method for method in LABELS if f"with_plan.{method}.rmse_m" in rows]
    if not ours:
        return made
    longer = pd.concat([_with_plan(rows, method) for method in ours])
    return {**made, "anchored": grouped(longer, [*by, "method"], _anchored)}


def _ate(own: pd.DataFrame) -> dict[str, str]:
    cells = {"drives": str(len(own)), "turns (degrees/s)": spread(own.turn_deg_s)}
    for method, label in LABELS.items():
        if (name := f"found.{method}.ate_m") in own:
            cells[f"{label}: ATE (m)"] = spread(own[name], ".3f")
    peers = own[[name for name in (f"found.{peer}.ate_m" for peer in PEERS) if name in own]].min(axis=1)
    ours = own["found.sgslam_imu.ate_m"] if "found.sgslam_imu.ate_m" in own else pd.Series(dtype=float)
    return {**cells, "ours with the IMU at most the better peer's": of((ours <= peers).sum(), len(own))}


def _errors(rows: pd.DataFrame, method: str) -> dict[str, str]:
    def of_method(field: str) -> "pd.Series[float]":
        return rows[f"found.{method}.{field}"]

    return {
        "drives": str(of_method("second_m").notna().sum()), "ATE (m)": spread(of_method("ate_m"), ".3f"),
        "in a second (m)": spread(of_method("second_m"), ".3f"),
        "in a second (degrees)": spread(of_method("second_deg"), ".2f"),
        "worst step (m)": spread(of_method("worst_step_m"), ".2f"),
        "poses missing": of(of_method("missing").sum(), rows.scans[of_method("missing").notna()].sum()),
        "scans a second": spread(rows[f"scans_per_s.{method}"]),
    }  # fmt: skip


def _with_plan(rows: pd.DataFrame, method: str) -> pd.DataFrame:
    """A line for each drive: the run with a plan, and as `level_m` the RMSE of the robot's in the same building, with
    the same sensor, seed and method."""
    key, before = ["building", "seed", "sensor", "imu"], f"with_plan.{method}."
    found = rows[[name for name in rows if name.startswith(before)]].rename(columns=lambda name: name[len(before) :])
    own = rows[[*key, "carrier"]].join(found).assign(method=LABELS[method])
    level = own[own.carrier == LEVEL_CARRIER][[*key, "rmse_m"]].rename(columns={"rmse_m": "level_m"})
    return own.merge(level, on=key, how="left")


def _anchored(own: pd.DataFrame) -> dict[str, str]:
    return {
        "anchored": of(own.anchored.sum(), len(own)), "RMSE (m)": spread(own.rmse_m, ".4f"),
        "coverage": coverage(own),
        "of the robot (m)": spread(own.level_m, ".4f"), "ratio": spread(own.rmse_m / own.level_m, ".2f"),
        "worst (m)": spread(own.worst_m, ".2f"), "scans wrong": of(own.wrong.sum(), own.scans.sum()),
        "first anchor (s)": spread(own.first_anchor_s),
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How exact our tracking with an IMU is, beside the better of the others."""
    peers = rows[[name for name in (f"found.{peer}.ate_m" for peer in PEERS) if name in rows]].min(axis=1)
    ratios = (rows["found.sgslam_imu.ate_m"] / peers).dropna()
    text = "ATE with an IMU, without a plan, relative to the better of RKO-LIO and GenZ-LIO (median, least, most)"
    return [Claim(text, spread(ratios, ".2f"), f"{len(ratios)} drives")]


QUICK = Choice(
    sequences=("institute", "office", "fzk-haus", "niedriha"), seeds=(1,), carriers=(LEVEL_CARRIER, RECORDING),
    imus=("mid360",), methods=("sgslam_imu", "rko_lio", "genz_lio"), anchored=("sgslam_imu",),
)  # fmt: skip
STUDY = Study(
    "inertial", "how well scans are tracked and runs anchored with an IMU, beside LiDAR-inertial odometries",
    Choice, QUICK, Run, Tracking, cases, measure, tables, claims, small=True, apart="methods",
)  # fmt: skip
