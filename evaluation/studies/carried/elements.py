"""Whether the verdicts on walls are true, in buildings whose walls stand off their plan by little, or not at all."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, PositiveFloat

from data.plans import load_bim
from data.simulation import Change, Changes
from evaluation.drives.carried import CarriedCase, carried
from evaluation.drives.conditions import Share
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveOptions, building_of
from evaluation.harness import Record, Study
from evaluation.harness.tables import grouped, of
from evaluation.metrics.trajectories import error_in_bim
from evaluation.studies.carried.carriers_tables import named
from sgslam.as_built.elements import SURE_SIGMAS, ElementVerdict, Verdict
from sgslam.cli.job.elements import run_verdicts
from sgslam.config import AsBuiltSettings, Config
from sgslam.slam import SceneGraphSlam

State = Literal["as planned", "moved", "absent"]
ENOUGH = 0.3  # of an element seen, from which a verdict is expected


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors`, with a share `moved` of the walls off by each of `moved_by_m`, and
    with a share `absent` of them not there. All over all `sequences` and `seeds`, `seconds` long; elements count as
    planned up to a `tolerance_m`."""

    sequences: tuple[str, ...] = ("office", "niedriha", "fzk-haus", "jesse", "generated-l-shape", "generated-office")
    carriers: tuple[str, ...] = ("wheeled", "handheld", "pole")
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32")
    moved: Share = 0.2
    moved_by_m: tuple[PositiveFloat, ...] = (0.015, 0.03)
    absent: Share = 0.1
    tolerance_m: PositiveFloat = 0.01
    seconds: PositiveFloat = 70.0


class Built(CarriedCase):
    """A drive through a building with shares of its walls `moved` by so much and `absent`."""

    moved: Share
    moved_by_m: PositiveFloat | None
    absent: Share
    tolerance_m: PositiveFloat


class Judged(BaseModel):
    """A wall with an answer: how it was built, with its `true_m` along the direction of the offset, and the verdict."""

    model_config = ConfigDict(frozen=True)

    built: State
    true_m: float
    verdict: Verdict
    offset_m: float | None
    sigma_m: float | None
    seen: float


class Verdicts(Record):
    """Of a run: its RMSE (m) in the BIM frame, None without an anchor; the walls with an answer, and how many have
    none, by how they were built."""

    rmse_m: float | None
    judged: tuple[Judged, ...]
    not_seen: dict[State, int]


def cases(options: Choice) -> list[Built]:
    """Each drive with each change."""
    changes: list[dict[str, Any]] = [
        *({"moved": options.moved, "moved_by_m": by, "absent": 0.0} for by in options.moved_by_m),
        {"moved": 0.0, "moved_by_m": None, "absent": options.absent},
    ]
    common = {"seconds": options.seconds, "tolerance_m": options.tolerance_m}
    return [
        Built(sequence=spec, seed=seed, carrier=carrier, sensor=sensor, **change, **common)
        for carrier in options.carriers for sensor in options.sensors for change in changes
        for spec, seed in options.drives()
    ]  # fmt: skip


def measure(case: Built, work: Path) -> Verdicts:
    """Runs the drive with the whole building as its plan."""
    bim = building_of(case.sequence, work)[0]
    plan = load_bim(bim).graph
    changes = Changes(moved=case.moved, absent=case.absent, moved_by=case.moved_by_m)
    with carried(case, work, changes=changes) as drive:
        config = Config(as_built=AsBuiltSettings(tolerance=case.tolerance_m))
        result = run_through(SceneGraphSlam(plan, config=config), drive.scans(), again=drive.scans())
        if not result.anchored:
            return Verdicts(rmse_m=None, judged=(), not_seen={})
        walls = [v for v in run_verdicts(result, bim, plan) if v.ifc_class.startswith("IfcWall")]
        built = {change.id: change for change in drive.changes}
        judged = [_judged(wall, built.get(wall.global_id)) for wall in walls]
        return Verdicts(
            rmse_m=error_in_bim(result.trajectory, drive.truth).position.rmse,
            judged=tuple(own for own in judged if own.verdict != "not seen"),
            not_seen=dict(Counter(own.built for own in judged if own.verdict == "not seen")),
        )


def _judged(wall: ElementVerdict, change: Change | None) -> Judged:
    built: State = "as planned" if change is None else "absent" if change.kind == "absent" else "moved"
    offset = (0.0, 0.0) if change is None else change.offset_in_bim
    true = 0.0 if wall.direction is None else float(np.dot(offset, wall.direction[:2]))
    return Judged(
        built=built, true_m=true, verdict=wall.verdict, offset_m=wall.offset_m, sigma_m=wall.sigma_m, seen=wall.seen
    )


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each carrier, sensor and change: what became of the walls."""
    rows = named(rows)
    by = rows.moved_by_m.map(lambda metres: "" if pd.isna(metres) else f"moved by {1000 * metres:.0f} mm")
    rows["walls"] = by.where(by != "", "some absent")
    walls = rows.explode("judged").dropna(subset="judged").reset_index(drop=True)
    walls = walls.drop(columns="judged").join(pd.DataFrame(walls.judged.tolist()))
    key = ["carrier", "sensor", "walls"]
    return {"verdicts": grouped(walls, key, _verdicts), "offsets": grouped(walls, key, _offsets)}


def _verdicts(own: pd.DataFrame) -> dict[str, str]:
    """How many of the walls with an answer got the right verdict, by how they were built."""
    plain, moved, absent = (own[own.built == state] for state in ("as planned", "moved", "absent"))
    enough = moved[moved.seen >= ENOUGH]
    return {
        "drives": str(own.drive.nunique()), "as planned": str(len(plain)),
        "of these, called moved": of((plain.verdict == "moved").sum(), len(plain)),
        "called absent": of((plain.verdict == "absent").sum(), len(plain)),
        "moved": of((enough.verdict == "moved").sum(), len(enough)),
        "moved, called as planned": of((enough.verdict == "as planned").sum(), len(enough)),
        "absent": of((absent.verdict == "absent").sum(), len(absent)),
        "absent, called moved": of((absent.verdict == "moved").sum(), len(absent)),
    }  # fmt: skip


def _offsets(own: pd.DataFrame) -> dict[str, str]:
    """How true the offsets and their standard deviations are, of walls that stand."""
    known = own[(own.built != "absent") & own.offset_m.notna()]
    errors = (known.offset_m - known.true_m).abs().astype(float)
    inside = errors <= SURE_SIGMAS * known.sigma_m.astype(float)
    return {
        "measured": str(len(known)), "median error (mm)": f"{1000 * errors.median():.1f}" if len(known) else "",
        "95 % (mm)": f"{1000 * errors.quantile(0.95):.1f}" if len(known) else "",
        "within two sigma": of(inside.sum(), len(known)),
    }  # fmt: skip


STUDY = Study(
    "elements", "whether verdicts on walls are true where they stand off the plan by 15 or 30 mm, or are absent",
    Choice, Choice(sequences=("fzk-haus",), seeds=(0,), carriers=("wheeled",), sensors=("VLP-16",)),
    Built, Verdicts, cases, measure, tables, small=True,
)  # fmt: skip
