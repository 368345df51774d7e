"""How well runs do on recordings of real buildings: SLABIM, ConSLAM, Hilti 2021, or recordings of one's own."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import BaseModel, PositiveFloat

from data import UserError
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.drives.runs import run_through
from evaluation.harness import Case, Options, Record, Study
from evaluation.studies.real.data_set import DataSet
from evaluation.studies.real.known import KNOWN, LISTS, data_set_in
from evaluation.studies.real.success import COARSE, FINE, aligned_rmse, piece_of_each, place_errors
from evaluation.studies.real.tables import claims, tables
from sgslam.report import associate
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam


class Choice(Options):
    """The folder of the data set, which of its recordings (all for none), and the lengths (m) of the pieces of the path
    that are also run on their own. `topic` is that of the scans where a bag has several."""

    dataset: Path | None = None
    sequences: tuple[str, ...] = ()
    submaps: tuple[PositiveFloat, ...] = (15.0, 30.0)
    topic: str | None = None


class Recorded(Case):
    """A recording, run as a whole, or piece by piece of `submap_m` metres of its way."""

    dataset: str
    folder: str
    sequence: str
    topic: str | None
    submap_m: float | None

    def files(self) -> set[str]:
        """The folder."""
        return {self.folder}


class End(BaseModel):
    """The errors at the last anchored scan of a run that has a true pose."""

    position_m: float
    yaw_deg: float


class Measured(Record):
    """The `runs` of a case pooled: how many are `anchored`, and the errors at the `ends` of these in the BIM frame.

    `scans` were read, and `unreadable` were skipped. Of the `true` ones, which have a true pose in the BIM frame, so
    many are anchored within 3 m and 5 degrees (`coarse`) and within 0.3 m and 1 degree (`fine`). The RMSEs are over all
    anchored scans with a true pose, the share `coverage` of the true ones. `aligned_rmse_m` is that of the run's own
    trajectory after alignment, of whole recordings.
    """

    runs: int
    anchored: int
    ends: tuple[End, ...]
    scans: int
    unreadable: int
    true: int
    coarse: int
    fine: int
    rmse_m: float | None
    yaw_rmse_deg: float | None
    aligned_rmse_m: float | None
    reason: str
    coverage: float | None = None


def cases(options: Choice) -> list[Recorded]:
    """Each recording as a whole and in pieces. Raises UserError without a data set, and for one that is not whole."""
    if options.dataset is None:
        known = ", ".join(kind.name for kind in KNOWN)
        raise UserError(f"real: --dataset DIR: give the folder of a data set ({known}: a folder with {LISTS[0]})")
    found = data_set_in(options.dataset, options.topic)
    sequences = _chosen(found, options.sequences)
    for sequence in sequences:
        found.check(sequence)
    common = {"dataset": found.name, "folder": str(options.dataset), "topic": options.topic}
    lengths = (None, *(options.submaps if found.has_plan else ()))
    return [Recorded(**common, sequence=name, submap_m=length) for length in lengths for name in sequences]


def _chosen(found: DataSet, names: tuple[str, ...]) -> list[str]:
    there = found.sequences()
    if unknown := sorted(set(names) - set(there)):
        raise UserError(f"{found.folder}: no sequence '{unknown[0]}' in it; there are: {', '.join(there)}")
    return [name for name in there if not names or name in names]


def measure(case: Recorded, work: Path) -> Measured:
    """Runs the recording. Raises UserError if no scan has a true pose, and as the readers do."""
    recording = data_set_in(Path(case.folder), case.topic).open(case.sequence, work)
    truth, stamps = recording.truth, list[int]()
    taken = _noted(recording.scans, stamps)
    pieces = [taken] if case.submap_m is None else _pieces(taken, truth, case.submap_m)
    results = [run_through(SceneGraphSlam(recording.plan), piece) for piece in pieces]
    has_plan = recording.plan is not None
    true = len(associate(np.array(stamps, np.int64), truth.stamps_ns)[0]) if has_plan else 0
    if has_plan and not true:
        raise UserError(f"{case.sequence}: no scan is within 10 ms of a true pose; their clocks must be the same")
    whole = results[0].trajectory_map if case.submap_m is None else None
    return Measured(
        runs=len(results), anchored=sum(result.anchored for result in results), scans=len(stamps),
        unreadable=len(recording.scans.skipped), true=true,
        aligned_rmse_m=None if whole is None else aligned_rmse(whole, truth, recording.point),
        reason=results[-1].reason if results else "", **_in_bim(results, truth, true),
    )  # fmt: skip


def _noted(scans: Iterable[Scan], stamps: list[int]) -> Iterator[Scan]:
    """The scans; their stamps are added to the list."""
    for scan in scans:
        stamps.append(scan.stamp_ns)
        yield scan


def _pieces(scans: Iterable[Scan], truth: Trajectory, length_m: float) -> Iterator[Iterator[Scan]]:
    """The scans of each piece of the path; those before, after and in the rest at its end are left out."""
    pieces = piece_of_each(truth, length_m)

    def piece(scan: Scan) -> int:
        at = int(np.searchsorted(truth.stamps_ns, scan.stamp_ns, side="right")) - 1
        return -1 if at < 0 or scan.stamp_ns > truth.stamps_ns[-1] else int(pieces[at])

    return (own for number, own in groupby(scans, piece) if number >= 0)


def _in_bim(results: list[Result], truth: Trajectory, true: int) -> Mapping[str, object]:
    """The errors of the anchored runs, pooled, over so many of the `true` scans."""
    found = [place_errors(result.trajectory, truth) for result in results if result.anchored]
    known = [errors for errors in found if len(errors.position_m)]
    ends = (End(position_m=e.position_m[-1], yaw_deg=np.degrees(e.yaw_rad[-1])) for e in known)
    squares = [np.concatenate([getattr(e, name) ** 2 for e in known]) for name in ("position_m", "yaw_rad") if known]
    rmse = [float(np.sqrt(values.mean())) for values in squares]
    return {
        "ends": tuple(ends), "coarse": sum(int(e.within(COARSE).sum()) for e in known),
        "fine": sum(int(e.within(FINE).sum()) for e in known), "rmse_m": rmse[0] if rmse else None,
        "yaw_rmse_deg": float(np.degrees(rmse[1])) if rmse else None,
        "coverage": sum(len(e.position_m) for e in known) / true if known else None,
    }  # fmt: skip


STUDY = Study(
    "real", "how well runs do on recordings of real buildings, whose folder is given",
    Choice, Choice(submaps=()), Recorded, Measured, cases, measure, tables, claims, brought=True,
)  # fmt: skip
