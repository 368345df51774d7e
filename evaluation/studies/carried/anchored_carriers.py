"""How well runs with a plan, from an unknown start, are anchored to the building, for several carriers."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field, PositiveFloat

from data.imu import ImuSamples
from data.scene_graph import SceneGraph
from data.simulation.effects.names import ALL, EFFECTS, TIMINGS
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveOptions, plan_of
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import coverage, grouped, of, often, rare, spread
from evaluation.metrics.regions import Inside, inside, pooled
from evaluation.metrics.trajectories import error_in_bim, wrong_poses
from evaluation.studies.carried.carriers import RECORDING, ate
from evaluation.studies.carried.carriers_tables import NO_EFFECT, named
from sgslam.session import Stopwatch
from sgslam.slam import SceneGraphSlam

LEVEL_CARRIER = "wheeled"
LONG_M = 60.0  # a shorter way shows too little of most buildings


class Choice(DriveOptions):
    """Each of `carriers` (a recorded motion may be one), those of `untimed` also without the points' times, and each of
    `effects` alone on a hand, with each of `few_sensors`; all effects together with each of `sensors`. Each over all
    `sequences` and `seeds`, or `per_cell` of these drives, drawn in turn; `seconds` long."""

    sequences: tuple[str, ...] = ("institute", "office", "fzk-haus", "niedriha", "jesse", "sample-house")
    per_cell: int | None = Field(None, ge=1)
    carriers: tuple[str, ...] = (LEVEL_CARRIER, "handheld", "pole", RECORDING)
    untimed: tuple[str, ...] = (RECORDING,)
    effects: tuple[str, ...] = tuple(name for name in EFFECTS if name not in TIMINGS)
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32", "OS1-64", "Mid-360")
    few_sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    seconds: PositiveFloat = 110.0


class Anchored(Record):
    """`length_m` is that of the path. Errors (m) of the anchored scans in the BIM frame, None without an
    anchor: the RMSE in space and in plan view, the mean magnitude in height, and the largest; `coverage` is the share
    of all scans that they are over. `odometry_m` and `map_m` are the ATE of the
    odometry and of the map's trajectory after SE(3) alignment, None where it is in several parts. `wrong` scans are
    called anchored and are off by more than 0.5 m or 5 degrees; `inside` says how often the anchored poses' 95 %
    regions hold the errors."""

    scans: int
    length_m: float
    anchored: bool
    reason: str
    first_anchor_s: float | None
    rmse_m: float | None
    plan_view_m: float | None
    height_m: float | None
    worst_m: float | None
    wrong: int
    inside: Inside | None
    map_m: float | None
    odometry_m: float | None
    lost: int
    kidnaps: int
    floors: int
    rooms: int
    scans_per_s: Annotated[float, "cost"]
    coverage: float | None = None


def cases(options: Choice) -> list[CarriedCase]:
    """Every cell of the design, in its buildings with its seeds."""
    drives = [
        CarriedCase(sequence=spec, seed=seed, seconds=options.seconds, **cell)
        for spec, seed, cell in options.in_turn(_cells(options), options.per_cell)
    ]
    return list({drive.key: drive for drive in drives}.values())


def _cells(options: Choice) -> Iterator[dict[str, Any]]:
    """The fields of each cell that differ from their defaults."""
    for sensor in options.few_sensors:
        for carrier in options.carriers:
            yield {"carrier": carrier, "sensor": sensor}
        for effect in options.effects:
            yield {"carrier": "handheld", "sensor": sensor, "effects": (effect,)}
        for carrier in options.untimed:
            yield {"carrier": carrier, "sensor": sensor, "times": False}
    for sensor in options.sensors:
        yield {"carrier": "handheld", "sensor": sensor, "effects": (ALL,)}


def measure(case: CarriedCase, work: Path) -> Anchored:
    """Simulates the drive and runs it with the whole building as its plan."""
    plan = plan_of(case.sequence, work)
    with carried(case, work) as drive:
        return run_with_plan(drive, plan)


def run_with_plan(drive: CarriedDrive, plan: SceneGraph, samples: ImuSamples | None = None) -> Anchored:
    """Runs a drive from an unknown start, with the samples of an IMU if given."""
    stopwatch = Stopwatch()
    slam = SceneGraphSlam(plan, stopwatch=stopwatch)
    result = run_through(slam, drive.scans(), again=drive.scans(), samples=samples)
    error = error_in_bim(result.trajectory, drive.truth) if result.anchored else None
    return Anchored(
        scans=drive.count, length_m=drive.length, anchored=result.anchored, reason=result.reason,
        first_anchor_s=result.first_anchor_s,
        rmse_m=None if error is None else error.position.rmse,
        plan_view_m=None if error is None else error.horizontal.rmse,
        height_m=None if error is None else _mean_height(result.trajectory, drive.truth),
        worst_m=None if error is None else error.position.max,
        wrong=wrong_poses(result.trajectory, drive.truth) if result.anchored else 0,
        inside=inside(result, drive.truth) if result.anchored else None,
        map_m=ate(result.trajectory_map, drive.truth), odometry_m=ate(result.trajectory_odometry, drive.truth),
        lost=result.tracked.get("lost", 0), kidnaps=slam.kidnaps, floors=len(result.s_graph.floors),
        rooms=len(result.s_graph.rooms), scans_per_s=drive.count / sum(stopwatch.seconds.values()),
        coverage=None if error is None else error.matched_poses / drive.count,
    )  # fmt: skip


def _mean_height(found: Trajectory, truth: Trajectory) -> float:
    """The mean magnitude (m) of the error in height."""
    return float(np.abs(found.positions[:, 2] - truth.at(found.stamps_ns)[:, 2, 3]).mean())


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each cell of the design: how many drives are anchored, of those whose level, clean twin is, and how
    well; why the others are not; how the whole run is compared with its odometry alone; and whether its standard
    deviations are true."""
    rows = named(rows)
    twin = rows[(rows.carrier == LEVEL_CARRIER) & (rows.effects == NO_EFFECT) & rows.anchored]
    key = ["building", "seed"]
    rows = rows.merge(twin[key].drop_duplicates().assign(twin=True), on=key, how="left")
    rows["twin"] = rows.twin.fillna(value=False).astype(bool)
    by = ["carrier", "effects", "sensor", "times", "seconds"]
    return {
        "anchored": grouped(rows, by, _cell),
        "not_anchored": rows[~rows.anchored].sort_values(["building", *by])[["building", *by[:4], "reason"]],
        "against_odometry": grouped(rows, ["sensor"], _against_odometry),
        "calibration": grouped(rows[rows.anchored], ["carrier", "effects"], pooled),
    }  # fmt: skip


def _cell(own: pd.DataFrame) -> dict[str, str]:
    with_twin = own[own.twin & (own.length_m > LONG_M)]
    return {
        "anchored": of(own.anchored.sum(), len(own)),
        f"of those over {LONG_M:.0f} m with an anchored twin": of(with_twin.anchored.sum(), len(with_twin)),
        "RMSE (m)": spread(own.rmse_m, ".3f"), "coverage": coverage(own),
        "plan view (m)": spread(own.plan_view_m, ".3f"),
        "mean error in height (m)": spread(own.height_m, ".3f"), "worst (m)": spread(own.worst_m, ".2f"),
        "scans wrong": of(own.wrong.sum(), own.scans.sum()),
        "first anchor (s)": spread(own.first_anchor_s),
    }  # fmt: skip


def _against_odometry(own: pd.DataFrame) -> dict[str, str]:
    whole = own.dropna(subset=["map_m", "odometry_m"])
    return {
        "drives": str(len(own)), "in one part": str(len(whole)), "odometry: ATE (m)": spread(whole.odometry_m, ".3f"),
        "map: ATE (m)": spread(whole.map_m, ".3f"), "no worse": of((whole.map_m <= whole.odometry_m).sum(), len(whole)),
        "worse by 1 cm": of((whole.map_m > whole.odometry_m + 0.01).sum(), len(whole)),
        "false kidnappings": of((own.kidnaps > 0).sum(), len(own)), "scans a second": spread(own.scans_per_s),
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many runs are anchored, how exactly, and how many of their scans are wrong."""
    own = rows[rows.anchored]
    cases = f"{len(rows)} drives, {rows['sequence.name'].nunique()} buildings"
    covered = f"{cases}, coverage {coverage(own)}"
    rmse = f"{1000 * own.rmse_m.median():.1f}, {1000 * own.rmse_m.quantile(0.9):.0f}"
    what = f"Runs from an unknown start, carriers and effects in turn ({', '.join(rows.sensor.unique())})"
    return [
        Claim(f"{what}: anchored", often(len(own), len(rows)), cases),
        Claim(f"{what}: RMSE in building coordinates (mm), of half and of 90 % of them at most", rmse, covered),
        Claim(
            f"{what}: of those anchored, with a scan called anchored that is wrong by over 0.5 m or 5 degrees",
            rare(int((own.wrong > 0).sum()), len(own)), cases,
        ),
    ]  # fmt: skip


STUDY = Study(
    "anchored_carriers", "how well runs with a plan are anchored, for any carrier, sensor and effect",
    Choice, Choice(sequences=("fzk-haus",), seeds=(0,), carriers=(LEVEL_CARRIER, "handheld"), effects=(),
                   sensors=("VLP-16",), few_sensors=("VLP-16",), seconds=40.0),
    CarriedCase, Anchored, cases, measure, tables, claims, small=True,
)  # fmt: skip
