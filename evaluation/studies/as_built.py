"""Precision and recall of reported deviations from the plan.

Each building is driven twice per seed: with a share of its walls moved by 10 to 30 cm, and with some walls absent and
some added that the plan lacks. The storey is given, since a similar unchanged storey would explain the map better.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from data.common.errors import UserError
from data.scans import ScanFolder
from data.simulation import Changes
from evaluation.drives.conditions import Conditions, Share
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveCase, DriveOptions, Sequence, SequenceSpec, prepare, storey_of
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import coverage, grouped, of, often
from evaluation.metrics.as_built_scores import KINDS, DeviationScore, deviation_scores
from evaluation.metrics.trajectories import error_in_bim
from evaluation.metrics.true_walls import TrueWall, true_walls
from sgslam.config import Config, MatchingSettings
from sgslam.mapping import KeyframeRule
from sgslam.slam import SceneGraphSlam

WITHIN_M = 0.03  # of a moved wall's true offset


class Choice(DriveOptions):
    """Which drives, and the shares of a storey's walls that are `moved`, and `gone`: absent, and as many added."""

    sequences: tuple[str, ...] = ("institute", "office")
    moved: Share = 0.3333
    gone: Share = 0.12
    method: str = MatchingSettings().method


class Changed(DriveCase):
    """A drive through a building that is not as planned."""

    conditions: Conditions
    method: str


class Deviations(Record):
    """The scores of a run's reports by kind, and its RMSE (m) in the BIM frame with the share of the scans that it is
    over; None if it is not anchored."""

    rmse_m: float | None
    moved: DeviationScore
    absent: DeviationScore
    extra: DeviationScore
    coverage: float | None = None


def cases(options: Choice) -> list[Changed]:
    """Each drive with walls moved, and with walls absent and added. Raises UserError for walls that are fixed."""
    drives = list(options.drives())
    for spec, _ in drives:
        if not spec.simulated or spec.is_mesh:
            raise UserError(f"'{spec.name}': not a simulated IFC model; leave it out, only those can be changed")
    gone = Conditions(absent_walls=options.gone, unplanned_walls=options.gone)
    changes = (Conditions(moved_walls=options.moved), gone)
    return [
        Changed(sequence=spec, seed=seed, conditions=conditions, method=options.method)
        for spec, seed in drives for conditions in changes if conditions.of_the_drive
    ]  # fmt: skip


def measure(case: Changed, work: Path) -> Deviations:
    """Runs the drive with the plan of its storey."""
    sequence = prepare(case.sequence, case.seed, work, case.conditions)
    storey = storey_of(sequence.a_graph, sequence.truth.poses[0])
    config = Config(matching=MatchingSettings(method=case.method))
    slam = SceneGraphSlam(sequence.a_graph.on_floor(storey), config=config)
    result = run_through(slam, ScanFolder(sequence.scan_dir), again=ScanFolder(sequence.scan_dir))
    walls = walls_of(case.sequence, sequence)
    scores = deviation_scores(result.deviations, result.s_graph, sequence.a_graph, result.T_bim_map, walls)
    if not result.anchored:
        return Deviations(rmse_m=None, **scores)
    error = error_in_bim(result.trajectory, sequence.truth)
    return Deviations(rmse_m=error.position.rmse, coverage=error.matched_poses / len(sequence.truth), **scores)


def walls_of(spec: SequenceSpec, sequence: Sequence) -> list[TrueWall]:
    """The true walls of a drive's storey, with the poses of would-be keyframes as viewpoints."""
    drive, c = sequence.scan_dir.parent, sequence.conditions
    rule = KeyframeRule(Config().keyframes)
    keyframes = [k for k, pose in enumerate(sequence.truth.poses) if rule.wants(pose)]
    settings = json.loads((drive / "run.json").read_text())
    ifc = drive.parent / settings["bim"] if spec.bim == "demo" else Path(spec.bim)
    changes = Changes(c.moved_walls, c.absent_walls, c.unplanned_walls)
    return true_walls(ifc, settings["storey"], changes, sequence.seed, sequence.truth, keyframes, drive / "walls.json")


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each sequence, what became of its walls, and kind of deviation, over its seeds."""

    def cells(own: pd.DataFrame) -> dict[str, str]:
        """Recall, precision and errors of the offsets over some drives."""
        right, reported, found, expected = own[["score.right", "score.answered", "score.found", "score.expected"]].sum()
        offsets = own.offset_errors.explode().dropna().astype(float)
        return {
            "drives": str(len(own)), "to find": str(expected), "recall": _share(found, expected),
            "precision": _share(right, reported),
            "offset error, median": f"{1000 * offsets.median():.1f} mm" if len(offsets) else "",
            "within 3 cm": of((offsets <= WITHIN_M).sum(), len(offsets)),
            "RMSE (m)": f"{own.rmse_m.mean():.4f}" if own.rmse_m.notna().any() else "not anchored",
            "coverage": coverage(own),
        }  # fmt: skip

    shares = zip(rows["conditions.moved_walls"], rows["conditions.absent_walls"], strict=True)
    walls = [f"{100 * m:.0f} % moved" if m else f"{100 * a:.0f} % absent, as many added" for m, a in shares]
    rows = rows.rename(columns={"sequence.name": "sequence"}).assign(walls=walls)
    kinds = pd.concat([_of_kind(rows, kind) for kind in KINDS]).sort_index(kind="stable")
    return {"deviations": grouped(kinds, ("sequence", "walls", "kind"), cells)}


def _of_kind(rows: pd.DataFrame, kind: str) -> pd.DataFrame:
    """The rows with the counts of one kind of deviation as columns of their own."""
    return rows.assign(kind=kind).rename(columns=lambda name: name.removeprefix(f"{kind}."))


def _share(part: int, whole: int) -> str:
    return f"{part / whole:.2f} ({of(part, whole)})" if whole else ""


def claims(rows: pd.DataFrame) -> list[Claim]:
    """Recall and precision of moved walls."""

    def claim(text: str, part: str, whole: str) -> Claim:
        counts, of_counts = rows[f"moved.score.{part}"], rows[f"moved.score.{whole}"]
        share = often(int(counts.sum()), int(of_counts.sum()))
        return Claim(text, share, f"{len(rows)} drives, {rows['sequence.name'].nunique()} buildings")

    return [
        claim("Walls built 10 to 30 cm off the plan that are reported", "found", "expected"),
        claim("Reports of moved walls that are true", "right", "answered"),
    ]


STUDY = Study(
    "as_built", "which walls that are not as planned are reported, and how many reports are false",
    Choice, Choice(sequences=("demo",), seeds=(0,)), Changed, Deviations, cases, measure, tables, claims,
)  # fmt: skip
