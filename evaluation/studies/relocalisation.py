"""Relocalisation of a second run in the map of a first run: how soon, and how accurate.

Two drives of one building. The first run saves its map; the second gets no initial pose. The second drive is entered
at several places, each in another room. With the building's plan both runs are anchored to it; without the plan, the
first run's S-graph serves as the plan.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field

from data.scans import ScanFolder
from data.trajectory import Trajectory
from evaluation.drives.second_run import RunMonitor, first_run
from evaluation.drives.sequences import DriveOptions, SequenceSpec, prepare, read_specs, select_sequences, storey_of
from evaluation.harness import Case, Claim, Record, Study
from evaluation.harness.tables import coverage, grouped, of, often, rare, spread
from evaluation.metrics.rooms_seen import RoomsNeeded, rooms_entered, rooms_needed, rooms_seen
from evaluation.metrics.trajectories import ape, error_in_bim
from matching import Matcher
from sgslam.config import Config, MatchingSettings
from sgslam.session import PriorMap
from sgslam.slam import SceneGraphSlam

Plan = Literal["bim", "map"]
PLANS = {"bim": "the BIM", "map": "the first map"}


class Choice(DriveOptions):
    """Which drives, each pair of consecutive seeds; the plan; shares of the second drive at which it is entered."""

    sequences: tuple[str, ...] = ("demo", "institute", "office")
    seeds: Annotated[tuple[int, ...], Field(min_length=2)] = (0, 1, 2)
    plans: tuple[Plan, ...] = ("bim", "map")
    starts: tuple[Annotated[float, Field(ge=0, lt=1)], ...] = (0.3, 0.6)
    method: str = MatchingSettings().method


class SecondRun(Case):
    """A second run that enters the drive of the seed `second` at `start`, in the map of the drive `first`."""

    sequence: SequenceSpec
    first: int
    second: int
    plan: Plan
    start: float
    method: str

    def files(self) -> set[str]:
        """The sequence's files."""
        return self.sequence.files()


class Relocalisation(Record):
    """`entered` and `seen` count rooms, `metres` and `seconds_driven` the effort, up to the final relocalisation.

    If the run was not relocalised, `entered` counts all rooms and the others are None. `known`: how many of the rooms
    entered are in the plan; a first map holds the rooms that the first run had entered or mostly seen. `needed` and
    `needed_sure`: how many rooms the matching benchmark needs from the start room on (see `RoomsNeeded`). `common`: how
    many of the rooms entered by the end were also entered by the first run. `wrong`: the share of scans with a wrong
    pose. `rmse_after_m` is over the final poses after relocalisation; `rmse_first_*_m` are the first run's, before and
    after the merge; `coverage` and `coverage_first` are the shares of the scans then that the RMSEs after are over.
    """

    found: bool
    needed: int | None
    needed_sure: int | None
    entered: int
    seen: int | None
    known: int
    common: int
    metres: float | None
    seconds_driven: float | None
    driven: float
    wrong: float
    rmse_after_m: float | None
    rmse_m: float | None
    rmse_first_before_m: float
    rmse_first_after_m: float | None
    rooms_first: int
    rooms_both: int
    coverage: float | None = None
    coverage_first: float | None = None


def cases(options: Choice) -> list[SecondRun]:
    """Every pair of consecutive seeds, with all plans and starts."""
    pairs = list(zip(options.seeds, (*options.seeds[1:], options.seeds[0]), strict=True))
    return [
        SecondRun(sequence=spec, first=first, second=second, plan=plan, start=start, method=options.method)
        for spec in select_sequences(read_specs(options.listed), options.sequences)
        for first, second in pairs for plan in options.plans for start in options.starts
    ]  # fmt: skip


def measure(case: SecondRun, work: Path) -> Relocalisation:
    """Runs the second drive in the first one's map. Raises UserError as `first_run` does."""
    config, anchored = Config(matching=MatchingSettings(method=case.method)), case.plan == "bim"
    first, second = (prepare(case.sequence, seed, work) for seed in (case.first, case.second))
    folder, before = first_run(first, anchored, config, work)
    known = PriorMap.load(folder, config)
    first_graph = known.floors.graph(known.backend.keyframes, [f.scene for f in known.floors.maps if f.scene])
    T_bim_known = known.T_bim_map
    if T_bim_known is None:  # best fit to the truth: the pose of the first map in the BIM frame is not known
        T_bim_known = ape(before, first.truth, "se3").T_truth_estimate
    slam = SceneGraphSlam(second.a_graph if anchored else None, config=config, prior=known)
    monitor, scans = RunMonitor(slam, second.truth, T_bim_known), list(ScanFolder(second.scan_dir))
    for scan in scans[int(case.start * len(scans)) :]:
        monitor.add(scan.stamp_ns, slam.add_scan(scan.stamp_ns, scan.points).T_map_sensor)
    s_graph = slam.s_graph()
    result = slam.finish()
    assert result.relocalisation is not None
    found, seen = result.relocalisation.found, monitor.relocalised or monitor.state(s_graph)
    floor = second.a_graph.on_floor(storey_of(second.a_graph, second.truth.poses[0]) or second.a_graph.floors[0].id)
    entered, driven = rooms_entered(floor, seen.places), rooms_entered(floor, np.array(monitor.places))
    there = set(floor.room_by_id)
    if not anchored:
        there = rooms_seen(first_graph, floor, T_bim_known, first.truth.positions)
    needed = RoomsNeeded()
    if driven:
        needed = rooms_needed(second.a_graph, driven[0], Matcher.load(case.method))
    T = np.eye(4) if result.anchored else T_bim_known
    return Relocalisation(
        found=found, needed=needed.most, needed_sure=needed.sure, entered=len(entered),
        seen=len(rooms_seen(seen.s_graph, floor, seen.T_bim_map, seen.places)) if found else None,
        known=len(there.intersection(entered)),
        common=len(set(driven).intersection(rooms_entered(floor, first.truth.positions))),
        metres=seen.metres if found else None,
        seconds_driven=(seen.stamp_ns - monitor.began_ns) / 1e9 if found else None, driven=monitor.driven,
        wrong=monitor.wrong / max(monitor.scans, 1),
        rmse_after_m=_error(result.trajectory, second.truth, T, seen.stamp_ns)[0] if found else None,
        coverage=_error(result.trajectory, second.truth, T, seen.stamp_ns)[1] if found else None,
        rmse_m=_error(result.trajectory, second.truth, T)[0] if found else None,
        rmse_first_before_m=_error(before, first.truth, np.eye(4) if anchored else T_bim_known)[0],
        rmse_first_after_m=_error(result.earlier[0], first.truth, T)[0] if found else None,
        coverage_first=_error(result.earlier[0], first.truth, T)[1] if found else None,
        rooms_first=len(first_graph.rooms), rooms_both=len(result.s_graph.rooms),
    )  # fmt: skip


def _error(
    run: Trajectory, truth: Trajectory, T_bim_run: NDArray[np.float64], since_ns: int = 0
) -> tuple[float, float]:
    """RMSE (m) of a run's positions, taken to the BIM frame by `T_bim_run`, from the stamp `since_ns` on, and the share
    of the scans since then that it is over."""
    error = error_in_bim(run.only(run.stamps_ns >= since_ns).transformed(T_bim_run), truth)
    return error.position.rmse, error.matched_poses / int((truth.stamps_ns >= since_ns).sum())


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each sequence and plan, over all of its second runs; and one for each second run."""
    rows = rows.assign(building=rows["sequence.name"], plan=rows.plan.map(PLANS))
    return {"summary": grouped(rows, ("building", "plan"), _summary), "runs": _runs(rows)}


def _summary(own: pd.DataFrame) -> dict[str, str]:
    found = own[own.found]
    return {
        "runs": str(len(own)), "found": str(len(found)), "never wrong": of((own.wrong == 0).sum(), len(own)),
        "rooms needed by most maps": spread(own.needed), "by 95 %": spread(own.needed_sure),
        "rooms entered until found": spread(found.entered), "of them in the plan": spread(found.known),
        "entered or mostly seen": spread(found.seen),
        "no more than needed by most maps": _within(found, "needed"),
        "no more than by 95 %": _within(found, "needed_sure"),
        "metres until found": spread(found.metres), "RMSE after (m), mean": _metres(found.rmse_after_m.mean()),
        "worst": _metres(found.rmse_after_m.max()), "coverage": coverage(found),
        "RMSE of the first run, before": _metres(found.rmse_first_before_m.mean()),
        "after": _metres(found.rmse_first_after_m.mean()), "coverage of the first": coverage(found, "coverage_first"),
    }  # fmt: skip


def _within(found: pd.DataFrame, needed: str) -> str:
    """How many of the runs with a known need were found within it."""
    asked = found[found[needed].notna()]
    return of((asked.known <= asked[needed]).sum(), len(asked))


def _metres(value: float, without: str = "", form: str = ".3f") -> str:
    return without if pd.isna(value) else format(value, form)


def _runs(rows: pd.DataFrame) -> pd.DataFrame:
    def number(values: "pd.Series[float]") -> "pd.Series[str]":
        return values.map(lambda value: _metres(value, form=".0f"))

    return pd.DataFrame({
        "building": rows.building, "plan": rows.plan,
        "runs": rows["first"].astype(str) + ", " + rows.second.astype(str), "start": rows.start,
        "rooms needed by most maps": number(rows.needed), "by 95 %": number(rows.needed_sure),
        "entered until found, or in all": rows.entered, "of them in the plan": rows.known,
        "entered or mostly seen": number(rows.seen), "metres": number(rows.metres),
        "placed wrongly": (100 * rows.wrong).map("{:.0f} %".format),
        "RMSE after (m)": rows.rmse_after_m.map(lambda value: _metres(value, "not found")),
        "coverage": [coverage(rows.loc[[at]]) for at in rows.index],
    })  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many second runs were found, and how many were ever at a wrong place."""
    found = often(int(rows.found.sum()), len(rows))
    wrong, count = rare((rows.wrong > 0).sum(), len(rows)), f"{len(rows)} second runs"
    return [
        Claim("Second runs that are relocalised in a first run's map", found, count),
        Claim("Second runs that were ever placed wrongly", wrong, count),
    ]


STUDY = Study(
    "relocalisation", "how soon and how accurately a second run is relocalised in the map of a first",
    Choice, Choice(sequences=("demo",), seeds=(0, 1), starts=(0.3,)), SecondRun, Relocalisation, cases, measure, tables,
    claims,
)  # fmt: skip
