"""Whether a run is ever anchored at a wrong place, whatever goes wrong with the recording, the carrier or the plan."""

from itertools import product
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from data import SceneGraph, UserError
from data.simulation.effects.names import ALL
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.sequences import DriveOptions, SequenceSpec, plan_of, storey_of
from evaluation.drives.troubles import BEGINS, NO_PLACE, TROUBLES, Trouble, TroubledDrive, twin_plan
from evaluation.harness import Record, Study
from evaluation.metrics.regions import Inside, inside
from evaluation.metrics.trajectories import error_in_bim, wrong_poses
from evaluation.studies.carried.carriers import RECORDING
from evaluation.studies.carried.trust_tables import claims, tables
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
    """A drive that is run once with each of `troubles`: to simulate it takes as long as a run. The foreign plan is that
    of the sequence `foreign`."""

    troubles: tuple[Trouble, ...]
    foreign: SequenceSpec

    def files(self) -> set[str]:
        """Those of the drive, and the foreign plan's."""
        return super().files() | (self.foreign.files() if "foreign" in self.troubles else set())


class Outcome(BaseModel):
    """What a run says of `scans` scans: how many it calls `anchored` and how many `lost` at the end; of the anchored
    ones how many are `wrong` (0.5 m or 5 degrees off, or in a plan that is not theirs), and the error (m) of the worst
    and the RMSE, and how many are `inside` their 95 % regions. `wrong_live` were so when they came. `alarms` are the
    signals out of their limits."""

    model_config = ConfigDict(frozen=True)

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


class Runs(Record):
    """The runs of a drive, by their trouble."""

    found: dict[Trouble, Outcome]


def cases(options: Choice) -> list[Troubled]:
    """The drives, each with all troubles that it can have."""
    drives = list(options.drives())
    cells = product(options.carriers, options.sensors, options.effects)
    fields = ({"carrier": carrier, "sensor": sensor, "effects": effects} for carrier, sensor, effects in cells)
    found = []
    for spec, seed, cell in options.in_turn(fields, options.per_cell):
        others = [other for other, _ in drives if other.bim != spec.bim]
        able = {"foreign": bool(others), "wrong storey": spec.storey is not None or spec.bim == "demo"}
        troubles = tuple(trouble for trouble in options.troubles if able.get(trouble, True))
        foreign = others[seed % len(others)] if others else spec
        found.append(
            Troubled(
                sequence=spec, seed=seed, seconds=options.seconds, troubles=troubles, foreign=foreign, **cell,
            )
        )  # fmt: skip
    return list({case.key: case for case in found}.values())


def measure(case: Troubled, work: Path) -> Runs:
    """Simulates the drive, again where the sensor is shaken, and runs it with each trouble. Raises UserError where a
    wrong storey is to be stated and the building has one only."""
    still = [trouble for trouble in case.troubles if trouble != "shaken"]
    found: dict[Trouble, Outcome] = {}
    if still:
        with carried(case, work) as drive:
            found |= {trouble: _run(case, trouble, drive, work) for trouble in still}
    if "shaken" in case.troubles:
        with carried(case, work, BEGINS * case.seconds) as drive:
            found["shaken"] = _run(case, "shaken", drive, work)
    return Runs(found=found)


def _run(case: Troubled, trouble: Trouble, drive: CarriedDrive, work: Path) -> Outcome:
    """Runs the drive with a trouble."""
    plan, troubled = _plan(case, trouble, work), TroubledDrive(drive, trouble, case.seconds)
    truth = troubled.truth
    storey = _another_storey(plan, storey_of(plan, truth.poses[0])) if trouble == "wrong storey" else None
    slam = SceneGraphSlam(plan, storey=storey)
    live = [slam.add_scan(scan.stamp_ns, scan.points, scan.point_times) for scan in troubled.scans()]
    result = slam.finish()
    count_wrong = _all if trouble in NO_PLACE else wrong_poses
    error = error_in_bim(result.trajectory, truth).position if result.anchored and len(result.trajectory) else None
    return Outcome(
        scans=len(live), anchored=len(result.trajectory) if result.anchored else 0,
        lost=result.tracked.get("lost", 0), wrong=count_wrong(result.trajectory, truth) if result.anchored else 0,
        wrong_live=count_wrong(_anchored_live(live), truth), worst_m=None if error is None else error.max,
        rmse_m=None if error is None else error.rmse, first_anchor_s=result.first_anchor_s, kidnaps=slam.kidnaps,
        inside=inside(result, truth) if result.anchored and trouble not in NO_PLACE else None,
        alarms=tuple(name for name, signal in result.quality.items() if not signal.ok), reason=result.reason,
    )  # fmt: skip


def _plan(case: Troubled, trouble: Trouble, work: Path) -> SceneGraph:
    plan = plan_of(case.foreign if trouble == "foreign" else case.sequence, work)
    return twin_plan(plan) if trouble == "twin" else plan


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


def _all(found: Trajectory, truth: Trajectory) -> int:
    return len(found)


STUDY = Study(
    "trust", "whether a run is ever anchored at a wrong place, whatever goes wrong",
    Choice, Choice(sequences=("fzk-haus", "office"), seeds=(0,), carriers=("handheld",), sensors=("VLP-16",),
                   effects=((),), seconds=50.0),
    Troubled, Runs, cases, measure, tables, claims, small=True,
)  # fmt: skip
