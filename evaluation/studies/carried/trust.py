"""Whether a run is ever anchored at a wrong place, whatever goes wrong with the recording, the carrier or the plan."""

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import Field, PositiveFloat

from data import SceneGraph, UserError
from data.simulation.effects.names import ALL
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, carried
from evaluation.drives.second_run import WRONG
from evaluation.drives.sequences import DriveOptions, SequenceSpec, plan_of, storey_of
from evaluation.drives.troubles import BEGINS, NO_PLACE, TROUBLES, Trouble, TroubledDrive, twin_plan
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import grouped, of, rare, spread
from evaluation.metrics.regions import Inside, inside
from evaluation.metrics.trajectories import error_in_bim
from evaluation.studies.carried.carriers import RECORDING
from evaluation.studies.carried.carriers_tables import named
from sgslam.geometry.frames import inverse
from sgslam.session import Update
from sgslam.slam import SceneGraphSlam


class Choice(DriveOptions):
    """Each of `troubles`, of each of `carriers` (or a recorded motion) with each of `sensors` and each of `effects`, in
    `per_cell` drives (building and seed) drawn in turn, all of them for None; each is `seconds` long. A foreign plan is
    that of another sequence; a wrong storey is stated where the building has several."""

    sequences: tuple[str, ...] = ("institute", "office", "fzk-haus", "niedriha", "jesse", "sample-house")
    troubles: tuple[Trouble, ...] = TROUBLES
    carriers: tuple[str, ...] = ("wheeled", "handheld", RECORDING)
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    effects: tuple[tuple[str, ...], ...] = ((), (ALL,))
    per_cell: int | None = Field(None, ge=1)
    seconds: PositiveFloat = 60.0


class Troubled(CarriedCase):
    """A drive with one trouble; `plan` is what the run gets, its own building's or a foreign one."""

    trouble: Trouble
    plan: SequenceSpec

    def files(self) -> set[str]:
        """Those of the drive, and the plan's."""
        return super().files() | self.plan.files()


class Told(Record):
    """What the run says of `scans` scans: how many it calls `anchored` and how many `lost` at the end; of the anchored
    ones how many are `wrong` (0.5 m or 5 degrees off, or in a plan that is not theirs), and the error (m) of the worst
    and the RMSE, and how many are `inside` their 95 % regions. `wrong_live` were so when they came. `alarms` are the
    signals out of their limits."""

    scans: int
    anchored: int
    lost: int
    wrong: int
    wrong_live: int
    worst_m: float | None
    rmse_m: float | None
    first_anchor_s: float | None
    kidnaps: int
    inside: Inside | None
    alarms: tuple[str, ...]
    reason: str


def cases(options: Choice) -> list[Troubled]:
    """Every trouble, in turn over all drives."""
    return list({case.key: case for case in _cases(options)}.values())


def _cases(options: Choice) -> Iterator[Troubled]:
    drives = list(options.drives())
    cells = product(options.carriers, options.sensors, options.effects, options.troubles)
    fields = ({"carrier": c, "sensor": s, "effects": e, "trouble": t} for c, s, e, t in cells)
    for spec, seed, cell in options.in_turn(fields, options.per_cell):
        others = [other for other, _ in drives if other.bim != spec.bim]
        plan = others[seed % len(others)] if cell["trouble"] == "foreign" and others else spec
        if (cell["trouble"] != "foreign" or others) and (cell["trouble"] != "wrong storey" or _has_storeys(spec)):
            yield Troubled(sequence=spec, seed=seed, seconds=options.seconds, plan=plan, **cell)


def _has_storeys(spec: SequenceSpec) -> bool:
    return spec.storey is not None or spec.bim == "demo"


def measure(case: Troubled, work: Path) -> Told:
    """Simulates the drive and runs it with the plan. Raises UserError where a wrong storey is to be stated and the
    building has one only."""
    plan = plan_of(case.plan, work)
    plan = twin_plan(plan) if case.trouble == "twin" else plan
    shaken = BEGINS * case.seconds if case.trouble == "shaken" else None
    with carried(case, work, shaken) as drive:
        troubled = TroubledDrive(drive, case.trouble, case.seconds)
        truth, storey = troubled.truth, None
        if case.trouble == "wrong storey":
            storey = _another_storey(plan, storey_of(plan, truth.poses[0]))
        slam = SceneGraphSlam(plan, storey=storey)
        live = [slam.add_scan(scan.stamp_ns, scan.points, scan.point_times) for scan in troubled.scans()]
        result = slam.finish()
    count_wrong = _all if case.trouble in NO_PLACE else wrong_poses
    error = error_in_bim(result.trajectory, truth).position if result.anchored and len(result.trajectory) else None
    return Told(
        scans=len(live), anchored=len(result.trajectory) if result.anchored else 0,
        lost=result.tracked.get("lost", 0), wrong=count_wrong(result.trajectory, truth) if result.anchored else 0,
        wrong_live=count_wrong(_anchored_live(live), truth), worst_m=None if error is None else error.max,
        rmse_m=None if error is None else error.rmse, first_anchor_s=result.first_anchor_s, kidnaps=slam.kidnaps,
        inside=inside(result, truth) if result.anchored and case.trouble not in NO_PLACE else None,
        alarms=tuple(name for name, signal in result.quality.items() if not signal.ok), reason=result.reason,
    )  # fmt: skip


def _another_storey(plan: SceneGraph, own: str | None) -> str:
    storey = next((floor.id for floor in plan.floors if floor.id != own), None)
    if storey is None:
        raise UserError("a wrong storey cannot be stated of a building with one; leave it out")
    return storey


def _anchored_live(live: list[Update]) -> Trajectory:
    """The poses in the BIM frame that were known when the scans came."""
    placed = [update for update in live if update.T_bim_sensor is not None and update.health != "lost"]
    stamps = np.array([update.stamp_ns for update in placed], np.int64)
    return Trajectory(stamps, np.reshape([update.T_bim_sensor for update in placed], (-1, 4, 4)))


def _all(told: Trajectory, truth: Trajectory) -> int:
    return len(told)


def wrong_poses(told: Trajectory, truth: Trajectory) -> int:
    """How many poses in the BIM frame are off by more than `WRONG`, in space or in attitude."""
    if not len(told):
        return 0
    off = inverse(truth.at(told.stamps_ns)) @ told.poses
    turned = np.arccos(np.clip((np.trace(off[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1.0, 1.0))
    return int(((np.linalg.norm(off[:, :3, 3], axis=1) > WRONG[0]) | (turned > WRONG[1])).sum())


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each trouble, and one for each trouble, carrier and sensor."""
    rows = named(rows)
    return {
        "troubles": grouped(rows, ["trouble", "effects"], _cells),
        "carriers": grouped(rows, ["trouble", "carrier", "effects", "sensor"], _cells),
    }


def _cells(own: pd.DataFrame) -> dict[str, str]:
    return {
        "drives": str(len(own)), "anchored": of((own.anchored > 0).sum(), len(own)),
        "scans anchored": f"{own.anchored.sum() / own.scans.sum():.1%}",
        "scans lost": f"{own.lost.sum() / own.scans.sum():.1%}",
        "RMSE (m)": spread(own.rmse_m, ".3f"),
        "drives wrong": of((own.wrong > 0).sum(), len(own)), "scans wrong": of(own.wrong.sum(), own.scans.sum()),
        "wrong while it ran": of((own.wrong_live > 0).sum(), len(own)),
        "wrong and no alarm": of(((own.wrong > 0) & (own.alarms.map(len) == 0)).sum(), len(own)),
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a run was anchored wrongly."""
    text = "Runs with a scan that is called anchored and is wrong by over 0.5 m or 5 degrees"
    value = rare(int((rows.wrong > 0).sum()), len(rows))
    return [Claim(text, value, f"{len(rows)} runs, {rows.trouble.nunique()} kinds")]


STUDY = Study(
    "trust", "whether a run is ever anchored at a wrong place, whatever goes wrong",
    Choice, Choice(sequences=("fzk-haus", "office"), seeds=(0,), carriers=("handheld",), sensors=("VLP-16",),
                   effects=((),), seconds=50.0),
    Troubled, Told, cases, measure, tables, claims, small=True,
)  # fmt: skip
