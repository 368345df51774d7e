"""How tracking and anchoring degrade as scans get worse, in nine ways and four severities each, for several sensors."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import Field, PositiveFloat

from data.common.errors import UserError
from evaluation.drives.carried import CarriedCase, carried
from evaluation.drives.perturbations import PERTURBATIONS, Perturbation, Perturbed, pace_of
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveOptions, plan_of
from evaluation.harness import Record, Study
from evaluation.metrics.trajectories import error_in_bim, wrong_poses
from evaluation.studies.carried.carriers import METHODS, RECORDING, Errors, Method, errors_of, instants
from evaluation.studies.carried.degradation_tables import claims, plots, tables
from sgslam.slam import SceneGraphSlam


class Choice(DriveOptions):
    """Each of `perturbations` in each of `severities` (0: none), with each of `sensors` in a hand, over all `sequences`
    and `seeds`, `seconds` long. Motion distortion is of the recorded motion `recording`, whose points' times are not
    given."""

    sequences: tuple[str, ...] = ("office", "fzk-haus")
    seeds: tuple[int, ...] = (0,)
    perturbations: tuple[Perturbation, ...] = PERTURBATIONS
    severities: tuple[int, ...] = (0, 1, 2, 3, 4)
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32", "Mid-360")
    recording: str = RECORDING
    seconds: PositiveFloat = 40.0


class Degraded(CarriedCase):
    """A drive with one perturbation in one severity."""

    perturbation: Perturbation
    severity: int = Field(ge=0, le=4)


class Measured(Record):
    """How many scans came; by method the errors of their poses, None where it gave none that can be compared. With the
    plan: how many scans are `anchored`, their RMSE (m) in space in the BIM frame, and how many are off by more than
    0.5 m or 5 degrees (`wrong`)."""

    scans: int
    found: dict[Method, Errors | None]
    anchored: int
    rmse_m: float | None
    wrong: int
    reason: str


def cases(options: Choice) -> list[Degraded]:
    """Every perturbation and severity, sensor and drive. Drives that are not perturbed are listed once."""
    cells = product(options.perturbations, options.severities, options.sensors)
    drives = [
        Degraded(sequence=spec, seed=seed, sensor=sensor, seconds=options.seconds, **_taken(what, severity, options))
        for what, severity, sensor in cells for spec, seed in options.drives()
    ]  # fmt: skip
    return list({drive.key: drive for drive in drives}.values())


def _taken(perturbation: Perturbation, severity: int, options: Choice) -> dict[str, Any]:
    """How the scans are taken, and made worse."""
    if severity == 0:
        return {"carrier": "handheld", "perturbation": PERTURBATIONS[0], "severity": 0}
    worse = {"perturbation": perturbation, "severity": severity}
    if perturbation == "motion distortion":
        return {**worse, "carrier": options.recording, "pace": pace_of(perturbation, severity), "times": False}
    return {**worse, "carrier": "handheld"}


def measure(case: Degraded, work: Path) -> Measured:
    """Simulates the drive, tracks it by each method, and runs it with the whole building as its plan."""
    plan = plan_of(case.sequence, work)
    with carried(case, work) as drive:
        perturbed = Perturbed(drive, case.perturbation, case.severity)
        came = replace(drive, count=sum(1 for _ in perturbed.scans()))
        found = dict[Method, Errors | None]()
        for method, track in METHODS.items():
            try:
                found[method] = errors_of(track(perturbed.scans()), came, instants(method, case.times))
            except UserError:
                found[method] = None
        result = run_through(SceneGraphSlam(plan), perturbed.scans(), again=perturbed.scans())
        anchored = len(result.trajectory) if result.anchored else 0
        return Measured(
            scans=came.count, found=found, anchored=anchored,
            rmse_m=error_in_bim(result.trajectory, drive.truth).position.rmse if anchored else None,
            wrong=wrong_poses(result.trajectory, drive.truth) if anchored else 0, reason=result.reason,
        )  # fmt: skip


QUICK = Choice(sequences=("demo",), sensors=("VLP-16",), severities=(0, 2, 4), seconds=20.0)
STUDY = Study(
    "degradation", "how tracking and anchoring degrade as scans get worse, in nine ways and four severities",
    Choice, QUICK, Degraded, Measured, cases, measure, tables, claims, plots, small=True,
)  # fmt: skip
