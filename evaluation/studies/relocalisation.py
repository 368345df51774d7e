"""A second run in the map of a first one: whether it is relocalised, how soon, and how accurately.

Two drives of one building by two seeds. The first run saves its map; the second gets no initial pose. With the plan
both are anchored to it; without, the first run's S-graph serves as the plan.
"""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.buildings import generated, plan_graph
from evaluation.drive import Drive, DriveCase, DriveOptions, drive_of, release
from evaluation.metrics.trajectories import ape
from evaluation.outcome import NO_POSES, Outcome
from evaluation.run import described, study_of_runs
from evaluation.study import Claim, Record
from evaluation.tables import ANCHORED, EVER_WRONG, Query, count, made, often, rare, spread, truth, units
from sgslam.config import Config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.result import Result
from sgslam.session import PriorMap
from sgslam.session.checkpoints import write_run
from sgslam.slam import SceneGraphSlam

Plan = Literal["the BIM", "the first map"]
Array = NDArray[np.float64]


class Choice(DriveOptions):
    """Each of `plans`; the second drive is entered at each of `starts`, shares of it."""

    buildings: tuple[str, ...] = (
        *("demo", "institute", "office", "fzk-haus", "niedriha"),
        *generated(50, 51),
    )
    seeds: tuple[int, ...] = (0, 1)
    plans: tuple[Plan, ...] = ("the BIM", "the first map")
    starts: tuple[float, ...] = (0.3, 0.6)
    seconds: float = 90.0


class SecondRun(DriveCase):
    """A second run, of the seed after that of the first, which begins at `start`."""

    plan: Plan
    start: float

    @property
    def group(self) -> str:
        """Second runs in maps of one drive share both drives."""
        return self.first.group

    @property
    def first(self) -> DriveCase:
        """The drive of the first run."""
        return DriveCase(**self.model_dump(exclude={"plan", "start"}))

    @property
    def second(self) -> DriveCase:
        """The drive of the second one."""
        return self.first.model_copy(update={"seed": self.seed + 1})


def cases(options: Choice) -> list[SecondRun]:
    """Every drive with all plans and starts."""
    designs = product(options.drives(), options.plans, options.starts)
    return [SecondRun(**drive, plan=plan, start=start) for drive, plan, start in designs]


def measure(case: SecondRun, work: Path) -> Record:
    """Runs both drives. Raises UserError if the first run cannot be anchored to the plan that it is given."""
    first, second = drive_of(case.first, work), drive_of(case.second, work)
    plan = plan_graph(first.plan) if case.plan == "the BIM" else None
    with TemporaryDirectory(dir=work) as folder:
        before = _first_run(first, plan, Path(folder))
        known = PriorMap.load(Path(folder), Config())
        T_bim_known = known.T_bim_map  # fitted to the truth where the map's pose in the BIM frame is not known
        if T_bim_known is None:
            T_bim_known = ape(before.trajectory, first.truth, "se3").T_truth_estimate
        slam = SceneGraphSlam(plan, config=Config(), prior=known)
        live, begins = dict[int, Array](), second.truth.stamps_ns[round(case.start * second.count)]
        scans = [scan for scan in second.scans() if scan.stamp_ns >= begins]
        for scan in scans:
            update = slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
            if (T_prior_map := slam.T_prior_map) is not None:
                live[update.stamp_ns] = T_bim_known @ T_prior_map @ update.T_map_sensor
        result = slam.finish()
    assert result.relocalisation is not None
    outcome = _outcome(result, second.truth, len(scans), np.eye(4) if result.anchored else T_bim_known, live)
    found_s = result.relocalisation.found_s
    until_ns = begins + round(1e9 * (found_s or 0.0))
    between = (second.truth.stamps_ns >= begins) & (second.truth.stamps_ns <= until_ns)
    steps = np.linalg.norm(np.diff(second.truth.positions[between], axis=0), axis=1)
    found = result.relocalisation.found
    facts = {"found": found, "found_s": found_s, "reason": result.relocalisation.reason}
    facts |= {"found_m": None if found_s is None else float(steps.sum()), "first_m": _ate(before.trajectory, first)}
    facts["first_after_m"] = _ate(result.earlier[0], first) if found else None
    return described(case) | outcome.measures() | facts


def _first_run(drive: Drive, plan: SceneGraph | None, folder: Path) -> Result:
    """The first run, whose map is saved."""
    slam = SceneGraphSlam(plan)
    for scan in drive.scans():
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
    result = slam.finish()
    if plan is not None and not result.anchored:
        raise UserError(f"the first run could not be anchored: {result.reason}")
    result.clouds.copy_to(folder / CLOUDS)
    write_run(folder, {"finished": True}, slam.state())
    return result


def _outcome(result: Result, truth_in_bim: Trajectory, scans: int, T_bim_run: Array, live: dict[int, Array]) -> Outcome:
    """The second run as one that is anchored where it was relocalised."""
    found = result.relocalisation is not None and result.relocalisation.found
    return Outcome(
        scans=scans,
        truth=truth_in_bim,
        anchored=result.trajectory.transformed(T_bim_run) if found else NO_POSES,
        map=result.trajectory_map,
        live=Trajectory(np.array([*live], np.int64), np.reshape([*live.values()], (-1, 4, 4))),
        stamps_ns=result.uncertainty.stamps_ns,
        sigma=np.full_like(result.uncertainty.sigma, np.nan),
        facts={"alarms": [name for name, signal in result.quality.items() if not signal.ok]},
    )


def _ate(found: Trajectory, drive: Drive) -> float:
    """The RMSE (m) after alignment: the shape of the map."""
    return ape(found, drive.truth, "se3").translation.rmse


def forget(case: SecondRun, work: Path) -> None:
    """Deletes both drives."""
    release(case.first, work)
    release(case.second, work)


COLUMNS = {
    **ANCHORED,
    "relocalised": count(lambda rows: truth(rows, "found")),
    "seconds until": spread("found_s"),
    "metres until": spread("found_m"),
    **EVER_WRONG,
    "first run: ATE (m)": spread("first_m", ".3f"),
    "after the second": spread("first_after_m", ".3f"),
}
QUERIES = {
    "plans": Query({"plan": "plan"}, COLUMNS),
    "runs": Query(
        {"plan": "plan", "building": "building", "start": "start"},
        {name: COLUMNS[name] for name in ("relocalised", "metres until")},
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """By plan, and each second run."""
    return made(QUERIES, rows)


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many second runs are relocalised, and how many were ever at a wrong place."""
    alone, wrong = rows[rows.plan.eq("the first map")], (rows.wrong > 0) | (rows.wrong_live > 0)
    found = often(truth(alone, "found"), alone.building)
    return [
        Claim("Second runs that are relocalised in a first run's map alone", found, units(alone)),
        Claim("Second runs that were ever placed wrongly", rare(wrong, rows.building), units(rows)),
    ]


QUICK = Choice(
    buildings=("demo", "fzk-haus", *generated(50)[:3]),
    seeds=(0,),
    starts=(0.3,),
    seconds=40.0,
)
STUDY = study_of_runs(
    "relocalisation",
    "whether, how soon and how accurately a second run is relocalised in the map of a first",
    QUICK,
    cases,
    tables,
    claims,
    case=SecondRun,
    measure=measure,
    release=forget,
)
