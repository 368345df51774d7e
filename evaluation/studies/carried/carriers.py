"""How well each scan's pose is tracked without a plan, for several carriers and sensors.

Each method gets the same scans: with their points' times where these are known, else without.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from time import process_time
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from data.common.errors import UserError
from data.scans import Scan
from data.simulation.effects.names import ALL, EFFECTS, TIMINGS
from data.trajectory import Trajectory
from evaluation.drives.carried import LEVEL, CarriedCase, CarriedDrive, Degrees, carried
from evaluation.drives.runs import tracked_by_run
from evaluation.drives.sequences import DriveOptions
from evaluation.harness import Record, Study
from evaluation.metrics.tracker_claims import PoseClaims, Reliability, reliability
from evaluation.metrics.tracking import errors_over_time, step_errors
from evaluation.metrics.trajectories import ape
from evaluation.slam_ablation.peers import kiss_icp_alone, small_gicp_alone
from evaluation.studies.carried.carriers_tables import claims, tables
from sgslam.config import Config

Method = Literal["sgslam", "kiss_icp", "small_gicp"]
Part = Literal["cells", "carriers", "effects", "all_effects", "mounts", "recording"]

RECORDING = "../shared/data/motion/handheld_survey.tum"
WARM_UP = 5  # scans that are run first, so that libraries and compiled loops are loaded before time counts


class Choice(DriveOptions):
    """Which `parts` of the design: `cells`, each of `carriers` and the `recording` with no, each or every one of
    `effects` and each of `sensors`, in `per_cell` drives (building and seed) drawn in turn; the others over all
    `sequences` and `seeds`: each of `carriers` with each of `sensors`; each of `effects` alone, on a hand with
    each of `few_sensors`; all effects together with each of `sensors`; each of `mounts` (roll, pitch, yaw in
    degrees) of the first sensor on the first carrier; the `recording` at each of `paces` (negative: backwards), with
    each of `few_sensors`, with the times given and not. Each is `seconds` long."""

    sequences: tuple[str, ...] = ("demo", "institute", "office", "basement", "house-1", "house-2")
    per_cell: int = Field(2, ge=1)
    parts: tuple[Part, ...] = ("carriers", "effects", "all_effects", "mounts", "recording")
    carriers: tuple[str, ...] = ("wheeled", "handheld", "pole")
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32", "OS1-64", "XT32", "Mid-360", "sector")
    few_sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    effects: tuple[str, ...] = tuple(name for name in EFFECTS if name not in TIMINGS)
    mounts: tuple[Degrees, ...] = (
        (0.0, 12.0, 0.0), (0.0, 25.0, 0.0), (0.0, 40.0, 0.0), (180.0, 0.0, 0.0), (0.0, 90.0, 0.0),
    )  # fmt: skip
    recording: str = RECORDING
    paces: tuple[float, ...] = (1.0, -1.0, 2.0, 4.0)
    seconds: PositiveFloat = 60.0
    methods: tuple[Method, ...] = ("sgslam", "kiss_icp", "small_gicp")


class Run(CarriedCase):
    """A drive and the methods that track it: simulating it again for each would take longer than tracking it."""

    methods: tuple[Method, ...]


@dataclass(frozen=True, eq=False)
class Found:
    """T_odom_sensor of the scans; what the method says of these poses, and how many kidnappings it saw, None where it
    tells neither."""

    poses: Trajectory
    claims: PoseClaims | None = None
    kidnaps: int | None = None


class Errors(BaseModel):
    """How well one method tracked a drive.

    `ate_m` is the RMSE of the positions after SE(3) alignment, None without enough motion; `second_*` are errors of the
    motion over a second, median and 95 %; `worst_step_m` is the largest error between neighbouring scans. `missing`
    scans have no pose. `instant` is where in a scan its pose holds, from 0 (its stamp) to 1 (its end). `kidnaps` is how
    often the sensor was thought to have been carried elsewhere: always wrongly. `reliability` is of our
    tracker only.
    """

    model_config = ConfigDict(frozen=True)

    missing: int
    instant: float
    ate_m: float | None
    second_m: float
    second_95_m: float
    second_deg: float
    second_95_deg: float
    worst_step_m: float
    kidnaps: int | None
    reliability: Reliability | None = None


class Tracking(Record):
    """The number of scans, and by method the errors and the scans tracked in a second of CPU time."""

    scans: int
    found: dict[Method, Errors]
    scans_per_s: Annotated[dict[Method, float], "cost"]


def cases(options: Choice) -> list[Run]:
    """Every cell of the design, in its buildings with its seeds."""
    common = {"seconds": options.seconds, "methods": options.methods}
    drives = [
        Run(sequence=spec, seed=seed, **common, **cell) for cell in _cells(options) for spec, seed in options.drives()
    ]
    if "cells" in options.parts:
        in_turn = options.in_turn(_all_cells(options), options.per_cell)
        drives += [Run(sequence=spec, seed=seed, **common, **cell) for spec, seed, cell in in_turn]
    return list({drive.key: drive for drive in drives}.values())


def _all_cells(options: Choice) -> Iterator[dict[str, Any]]:
    """Each carrier with no, each or every effect and each sensor."""
    carriers, effects = (*options.carriers, options.recording), ((), *((own,) for own in options.effects), (ALL,))
    for carrier, chosen, sensor in product(carriers, effects, options.sensors):
        yield {"carrier": carrier, "effects": chosen, "sensor": sensor}


def _cells(options: Choice) -> Iterator[dict[str, Any]]:
    """The fields of each cell that differ from their defaults."""
    hand = "handheld"
    if "carriers" in options.parts:
        for carrier, sensor in product(options.carriers, options.sensors):
            yield {"carrier": carrier, "sensor": sensor}
    if "effects" in options.parts:
        for effect, sensor in product(options.effects, options.few_sensors):
            yield {"carrier": hand, "sensor": sensor, "effects": (effect,)}
    if "all_effects" in options.parts:
        for sensor in options.sensors:
            yield {"carrier": hand, "sensor": sensor, "effects": (ALL,)}
    if "mounts" in options.parts:
        for mount in (LEVEL, *options.mounts):
            yield {"carrier": options.carriers[0], "sensor": options.sensors[0], "mount_deg": mount}
    if "recording" in options.parts:
        for pace, sensor, times in product(options.paces, options.few_sensors, (True, False)):
            played = {"carrier": options.recording, "pace": abs(pace), "backwards": pace < 0}
            yield {**played, "sensor": sensor, "times": times}


def measure(case: Run, work: Path) -> Tracking:
    """Simulates the drive and tracks it by each method."""
    found, scans_per_s = dict[Method, Errors](), dict[Method, float]()
    with carried(case, work) as drive:
        for method in case.methods:
            track = METHODS[method]
            track(drive.scans(WARM_UP))
            began = process_time()
            tracked = track(drive.scans())
            scans_per_s[method] = drive.count / (process_time() - began)
            found[method] = errors_of(tracked, drive, instants(method, case.times))
    return Tracking(scans=drive.count, found=found, scans_per_s=scans_per_s)


def instants(method: Method, times: bool) -> tuple[float, ...]:
    """Where in a scan the poses of a method may hold, from 0 (its stamp) to 1 (its end).

    Ours hold at the stamp; the others deskew to the end. Without times it is unknown: the best counts, for all alike.
    """
    if not times:
        return 0.0, 0.5, 1.0
    return (0.0,) if method == "sgslam" else (1.0,)


def errors_of(found: Found, drive: CarriedDrive, at: tuple[float, ...]) -> Errors:
    """The errors of the poses found, which hold at the best of the instants `at`."""

    def shifted(instant: float) -> Trajectory:
        return Trajectory(found.poses.stamps_ns + round(1e9 * instant * drive.period_s), found.poses.poses)

    by_instant = {instant: errors_over_time(shifted(instant), drive.truth) for instant in at}
    instant = min(at, key=lambda own: float(np.median(by_instant[own].translation_m)))
    second, poses = by_instant[instant], shifted(instant)
    metres, degrees = second.translation_m, np.degrees(second.rotation_rad)
    return Errors(
        missing=drive.count - len(poses), instant=instant, ate_m=ate(poses, drive.truth),
        second_m=float(np.median(metres)), second_95_m=float(np.percentile(metres, 95)),
        second_deg=float(np.median(degrees)), second_95_deg=float(np.percentile(degrees, 95)),
        worst_step_m=float(step_errors(poses, drive.truth).translation_m.max()),
        kidnaps=found.kidnaps,
        reliability=None if found.claims is None else reliability(found.claims, poses, drive.truth),
    )  # fmt: skip


def ate(found: Trajectory, truth: Trajectory) -> float | None:
    """The RMSE (m) after SE(3) alignment; None for too little motion."""
    try:
        return ape(found, Trajectory(found.stamps_ns, truth.at(found.stamps_ns)), "se3").translation.rmse
    except UserError:
        return None


def _sgslam(scans: Iterable[Scan]) -> Found:
    """Our tracker, as a run without a plan uses it, and what it says of its poses."""
    drive = tracked_by_run(scans, Config())
    health = np.array([scan.health for scan in drive.scans])
    covariances = np.stack([scan.covariance for scan in drive.scans])
    return Found(drive.poses, PoseClaims(covariances, health, drive.poses.poses[:, 2, :3]), drive.kidnaps)


METHODS: dict[Method, Callable[[Iterable[Scan]], Found]] = {
    "sgslam": _sgslam,
    "kiss_icp": lambda scans: Found(kiss_icp_alone(scans)),
    "small_gicp": lambda scans: Found(small_gicp_alone(scans)),
}
QUICK = Choice(
    sequences=("demo",), seeds=(0,), parts=("carriers", "all_effects", "mounts", "recording"),
    carriers=("wheeled", "handheld"), sensors=("VLP-16",), few_sensors=("VLP-16",), mounts=((0.0, 12.0, 0.0),),
    paces=(1.0,), seconds=20.0,
)  # fmt: skip
STUDY = Study(
    "carriers", "how well each scan is tracked without a plan, for any carrier, mount, sensor and effect",
    Choice, QUICK, Run, Tracking, cases, measure, tables, claims, small=True, apart="methods",
)  # fmt: skip
