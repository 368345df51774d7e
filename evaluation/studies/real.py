"""How accurate runs are on recordings of real buildings: SLABIM, ConSLAM, or recordings of one's own."""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import PositiveFloat

from data.common.errors import UserError
from data.datasets import KNOWN, data_set_in
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.buildings import plan_graph
from evaluation.metrics.trajectories import ape, error_in_bim, matched
from evaluation.study import Case, Claim, Options, Record, Study
from evaluation.tables import Column, Query, count, made, of, share, spread
from sgslam.geometry.trajectory_errors import associate
from sgslam.result import Result
from sgslam.slam import SceneGraphSlam

LIMITS = (3.0, 5.0), (0.3, 1.0)  # m and degrees


class Choice(Options):
    """The folder of the data set, which of its recordings (all for none), and the lengths (m) of the pieces of the path
    that are also run on their own. `topic` is that of the scans where a bag has several."""

    dataset: Path | None = None
    sequences: tuple[str, ...] = ()
    pieces: tuple[PositiveFloat, ...] = (15.0, 30.0)
    topic: str | None = None


class Recorded(Case):
    """A recording, run as a whole, or piece by piece of `piece_m` metres of its way."""

    dataset: str
    building: str
    folder: str
    sequence: str
    topic: str | None
    piece_m: float | None


def cases(options: Choice) -> list[Recorded]:
    """Each recording as a whole and in pieces. Raises UserError without a data set, and for one that is not whole."""
    if options.dataset is None:
        known = ", ".join(KNOWN)
        raise UserError(f"real: --dataset DIR: give the folder of a data set ({known}: a folder with sequences.yaml)")
    found = data_set_in(options.dataset, options.topic)
    there = list(found.entries)
    if unknown := sorted(set(options.sequences) - set(there)):
        raise UserError(f"{found.folder}: no sequence '{unknown[0]}' in it; there are: {', '.join(there)}")
    chosen = [name for name in there if not options.sequences or name in options.sequences]
    for sequence in chosen:
        found.check(sequence)
    common = {"dataset": found.name, "folder": str(options.dataset), "topic": options.topic}
    return [
        Recorded(**common, building=found.building(name), sequence=name, piece_m=length)
        for name in chosen
        for length in (None, *options.pieces)
    ]


def measure(case: Recorded, work: Path) -> Record:
    """Runs the recording: as a whole with the second pass, in pieces with one pass.

    The record has the `runs` and how many are `anchored`; of the `scans` in them those with a `true` pose in the BIM
    frame, and of these the `placed` ones, which are anchored. RMSEs are over all placed scans, without alignment;
    `ends` are metres and degrees at the last one of each run. `aligned_rmse_m` is of a whole run's map, aligned. Raises
    UserError if no scan has a true pose, and as the readers do.
    """
    recording = data_set_in(Path(case.folder), case.topic).open(case.sequence, work / f"pieces-{case.piece_m}")
    plan, truth = plan_graph(recording.plan), recording.truth
    whole, stamps, results = case.piece_m is None, list[int](), list[Result]()
    for scans in [recording.scans] if case.piece_m is None else _pieces(recording.scans, truth, case.piece_m):
        slam = SceneGraphSlam(plan, storey=recording.storey)
        for scan in scans:
            slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
            stamps.append(scan.stamp_ns)
        results.append(slam.finish(second_pass=whole))
    true = len(associate(np.array(stamps, np.int64), truth.stamps_ns)[0])
    if results and not true:
        raise UserError(f"{case.sequence}: no scan is within 10 ms of a true pose; their clocks must be the same")
    return {
        "runs": len(results),
        "anchored": sum(result.anchored for result in results),
        "scans": len(stamps),
        "unreadable": len(recording.scans.skipped),
        "true": true,
        **_in_bim([result.trajectory for result in results if result.anchored], truth),
        "aligned_rmse_m": aligned_rmse(results[0].trajectory_map, truth) if whole else None,
        "first_anchor_s": results[0].first_anchor_s if whole else None,
        "reasons": sorted({result.reason for result in results}),
    }


def _pieces(scans: Iterable[Scan], truth: Trajectory, length_m: float) -> Iterator[Iterator[Scan]]:
    """The scans of each piece of the true path; those before, after and in the rest at its end (-1) are omitted."""
    way = np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0, prepend=truth.positions[:1]), axis=1))

    def piece(scan: Scan) -> int:
        at = int(np.searchsorted(truth.stamps_ns, scan.stamp_ns, side="right")) - 1
        outside = at < 0 or scan.stamp_ns > truth.stamps_ns[-1] or way[at] >= way[-1] // length_m * length_m
        return -1 if outside else int(way[at] // length_m)

    return (part for number, part in groupby(scans, piece) if number >= 0)


def _in_bim(anchored: list[Trajectory], truth: Trajectory) -> Record:
    """The errors of the anchored runs, pooled."""
    known = [run for run in anchored if len(associate(run.stamps_ns, truth.stamps_ns)[0])]
    if not known:
        return {"placed": 0, "ends": []}
    stamps, poses = (np.concatenate([getattr(run, name) for run in known]) for name in ("stamps_ns", "poses"))
    error = error_in_bim(Trajectory(stamps, poses), truth)
    ends = [error_in_bim(run.only(run.stamps_ns == matched(run, truth).stamps_ns[-1]), truth) for run in known]
    return {
        "placed": error.matched_poses,
        "rmse_m": error.position.rmse,
        "plan_view_m": error.horizontal.rmse,
        "height_m": error.height.rmse,
        "yaw_deg": float(np.degrees(error.yaw.rmse)),
        "ends": [(end.position.rmse, float(np.degrees(end.yaw.rmse))) for end in ends],
    }


def aligned_rmse(estimate: Trajectory, truth: Trajectory) -> float | None:
    """The RMSE (m) of the positions after SE(3) alignment of the estimate, which is interpolated at the truth's stamps;
    None where these do not determine the alignment."""
    stamps = truth.between(estimate).stamps_ns
    try:
        return ape(Trajectory(stamps, estimate.at(stamps)), truth, "se3").translation.rmse
    except (UserError, ValueError):  # too few poses, or on a line
        return None


def _within(metres: float, degrees: float) -> Column:
    """A column: how many runs are anchored and end so close to the truth."""
    return lambda rows: of(
        sum(m <= metres and deg <= degrees for ends in rows.ends for m, deg in ends), rows.runs[rows.true > 0].sum()
    )


PLACED: dict[str, Column] = {
    "anchored": lambda rows: of(rows.anchored.sum(), rows.runs[rows.true > 0].sum()),
    **{f"ends within {m:g} m, {deg:g} deg": _within(m, deg) for m, deg in LIMITS},
    "coverage (%)": share("placed", "true"),
    "RMSE (m)": spread("rmse_m", ".3f"),
    "plan view (m)": spread("plan_view_m", ".3f"),
    "height (m)": spread("height_m", ".3f"),
    "yaw (deg)": spread("yaw_deg", ".2f"),
}
WHOLE = {"scans": spread("scans"), **PLACED, "after alignment (m)": spread("aligned_rmse_m", ".3f")}
PIECES: dict[str, Column] = {"pieces": lambda rows: f"{rows.runs.sum()}", **PLACED}
QUERIES = {
    "datasets": Query({"dataset": "data set"}, {"recordings": count(), **WHOLE}, lambda rows: rows.piece_m.isna()),
    "recordings": Query({"sequence": "recording"}, WHOLE, lambda rows: rows.piece_m.isna()),
    "pieces": Query({"piece_m": "length (m)"}, PIECES, lambda rows: rows.piece_m.notna()),
}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many recordings with a plan are anchored and end at their place, and their error."""
    whole = rows[rows.piece_m.isna() & (rows.true > 0)]
    units = f"{len(whole)} recordings, {whole.building.nunique()} buildings"
    names = ("anchored", "ends within 0.3 m, 1 deg", "RMSE (m)") if len(whole) else ()
    return [Claim(f"Real recordings: {name}", PLACED[name](whole), units) for name in names]


STUDY = Study(
    name="real",
    asks="how accurate runs are on recordings of real buildings, whose folder is given",
    options=Choice,
    quick=Choice(pieces=()),
    case=Recorded,
    cases=cases,
    measure=measure,
    tables=partial(made, QUERIES),
    claims=claims,
    brought=True,
)
