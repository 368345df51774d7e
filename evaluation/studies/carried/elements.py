"""Whether the verdicts on elements are true, in buildings that differ from their plan by little, or lack walls."""

from collections import Counter
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import PositiveFloat

from data.plans import load_bim
from data.simulation import Changes
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveOptions, building_of
from evaluation.harness import Record, Study
from evaluation.metrics.trajectories import error_in_bim
from evaluation.metrics.true_walls import TrueWall, true_walls
from evaluation.studies.carried.elements_tables import claims, tables
from evaluation.studies.carried.elements_truth import (
    Building,
    Judged,
    State,
    Unplanned,
    entered_m2,
    unplanned_found,
    with_fillings,
)
from sgslam.as_built.elements import unplanned_walls
from sgslam.config import AsBuiltSettings, Config
from sgslam.session import Result
from sgslam.session.result import run_verdicts, without_planned_things
from sgslam.slam import SceneGraphSlam

Cell = Literal["15 mm", "30 mm", "absent"]
POLE = "pole"
# 97 mm: no multiple of the steps in which displacements are searched
CHANGES: dict[Cell, Changes] = {
    "15 mm": Changes(moved=0.2, moved_by=0.015, openings_displaced=0.2, columns_displaced=0.3, displaced_by=0.097),
    "30 mm": Changes(moved=0.2, moved_by=0.03, openings_filled=0.2, columns_absent=0.3),
    "absent": Changes(absent=0.1, unplanned=0.1),
}
EFFECTS: dict[Cell, tuple[str, ...]] = {"15 mm": (), "30 mm": (), "absent": ("shelves",)}


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors`, a pole only with `few_sensors`, in the buildings of all `cells`. All
    over all `sequences` and `seeds`, `seconds` long, with more `effects` if given; elements count as planned up to a
    `tolerance_m`. Meshes refuse changes."""

    sequences: tuple[str, ...] = ("office", "niedriha", "fzk-haus", "jesse", "institute", "demo")
    carriers: tuple[str, ...] = ("wheeled", "handheld", POLE)
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32")
    few_sensors: tuple[str, ...] = ("VLP-16",)
    cells: tuple[Cell, ...] = tuple(CHANGES)
    effects: tuple[str, ...] = ()
    tolerance_m: PositiveFloat = 0.01
    seconds: PositiveFloat = 70.0


class Built(CarriedCase):
    """A drive through a building with the `changes` of a cell."""

    cell: Cell
    changes: Changes
    tolerance_m: PositiveFloat


class Verdicts(Record):
    """Of a run: its RMSE (m) in the BIM frame and the share of the scans that it is over, None without an anchor;
    walls, doors, windows and columns with their verdicts, but of those that stand as planned only the ones that were
    seen; how many were `not_seen`, by how they were built; and the unplanned walls, None without an anchor."""

    rmse_m: float | None
    judged: tuple[Judged, ...]
    not_seen: dict[State, int]
    unplanned: Unplanned | None
    coverage: float | None = None


def cases(options: Choice) -> list[Built]:
    """Each drive with each building."""
    common = {"seconds": options.seconds, "tolerance_m": options.tolerance_m}
    return [
        Built(sequence=spec, seed=seed, carrier=carrier, sensor=sensor, **_of_cell(cell, options), **common)
        for carrier in options.carriers for sensor in _sensors(carrier, options)
        for cell in options.cells for spec, seed in options.drives()
    ]  # fmt: skip


def _sensors(carrier: str, options: Choice) -> list[str]:
    return [sensor for sensor in options.sensors if carrier != POLE or sensor in options.few_sensors]


def _of_cell(cell: Cell, options: Choice) -> dict[str, Any]:
    return {
        "cell": cell, "changes": CHANGES[cell], "effects": tuple(dict.fromkeys([*EFFECTS[cell], *options.effects])),
    }  # fmt: skip


def measure(case: Built, work: Path) -> Verdicts:
    """Runs the drive with the whole building as its plan, without the unplanned walls, and without a start pose."""
    with carried(case, work, changes=case.changes) as drive:
        plan = load_bim(drive.plan).graph
        config = Config(as_built=AsBuiltSettings(tolerance=case.tolerance_m))
        result = run_through(SceneGraphSlam(plan, config=config), drive.scans(), again=drive.scans())
        result = without_planned_things(result, drive.plan)
        if not result.anchored or result.T_bim_map is None:
            return Verdicts(rmse_m=None, judged=(), not_seen={}, unplanned=None)
        walls = _true_walls(case, drive, result, work)
        building = Building(
            with_fillings(building_of(case.sequence, work)[0], drive.changes),
            {change.id: change for change in drive.stands_off}, {wall.id: wall.views for wall in walls},
        )  # fmt: skip
        entries = map(building.judged, run_verdicts(result, drive.plan))
        judged = [entry for entry in entries if entry is not None]
        extra = unplanned_walls(result.deviations, result.s_graph, result.T_bim_map, result.matches, plan)
        entered, error = entered_m2(plan, drive.truth), error_in_bim(result.trajectory, drive.truth)
        return Verdicts(
            rmse_m=error.position.rmse,
            coverage=error.matched_poses / drive.count,
            judged=tuple(own for own in judged if (own.built, own.verdict) != ("as planned", "not seen")),
            not_seen=dict(Counter(own.built for own in judged if own.verdict == "not seen")),
            unplanned=unplanned_found([wall.trace for wall in extra], walls, entered),
        )


def _true_walls(case: Built, drive: CarriedDrive, result: Result, work: Path) -> list[TrueWall]:
    """The storey's walls, seen from where the keyframes with a cloud were in truth."""
    bim, storey = building_of(case.sequence, work)
    stamps = [k.stamp_ns for k in result.s_graph.keyframes if len(result.clouds[int(k.id[1:])])]
    scans = np.searchsorted(drive.truth.stamps_ns, stamps).tolist()
    return true_walls(bim, storey, case.changes, case.seed, drive.truth, scans, drive.folder.parent / "walls.json")


STUDY = Study(
    "elements", "whether the verdicts on walls, openings and columns are true, and whether unplanned walls are found",
    Choice, Choice(sequences=("fzk-haus",), seeds=(0,), carriers=("wheeled",), sensors=("VLP-16",)),
    Built, Verdicts, cases, measure, tables, claims, small=True,
)  # fmt: skip
