"""What a second pass over all scans gains: the same run before and after it, for several carriers."""

from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
import pandas as pd

from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, carried
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import plan_of
from evaluation.harness import Record, Study
from evaluation.harness.tables import grouped, of, spread
from evaluation.metrics.regions import Inside, inside, pooled
from evaluation.metrics.trajectories import error_in_bim, wrong_poses
from evaluation.studies.carried import anchored_carriers
from evaluation.studies.carried.carriers_tables import named
from sgslam.slam import SceneGraphSlam

NO_WORSE_M = 0.001  # by which an RMSE may grow and counts as the same


class Errors(Record):
    """Errors (m) of all anchored scans in the BIM frame: the RMSE in space, in plan view, and of the scans before the
    first anchor, None where there are none; the mean magnitude in height; the largest. `wrong` scans are off by more
    than 0.5 m or 5 degrees. `inside`: how often the 95 % regions of the poses hold the errors, None for live poses."""

    rmse_m: float
    plan_view_m: float
    before_anchor_m: float | None
    height_m: float
    worst_m: float
    wrong: int
    inside: Inside | None = None


class Passes(Record):
    """The same run after one pass and after two, and as it was known `live`; None where it is not anchored. CPU
    seconds of each pass."""

    scans: int
    live: Errors | None
    single: Errors | None
    second: Errors | None
    single_s: Annotated[float, "cost"]
    second_s: Annotated[float, "cost"]


def measure(case: CarriedCase, work: Path) -> Passes:
    """Simulates the drive, and runs it with the whole building as its plan."""
    plan = plan_of(case.sequence, work)
    with carried(case, work) as drive:
        slam, times = SceneGraphSlam(plan), [process_time()]
        single = run_through(slam, drive.scans())
        times.append(process_time())
        second = slam.finish(drive.scans())
        times.append(process_time())
        anchor_ns = drive.truth.stamps_ns[0] + round(1e9 * (second.first_anchor_s or 0.0))
        live = None
        if second.anchored and second.trajectory_live is not None:
            live = _errors(second.trajectory_live, drive.truth, anchor_ns, None)
        errors = {
            name: _errors(own.trajectory, drive.truth, anchor_ns, inside(own, drive.truth)) if own.anchored else None
            for name, own in (("single", single), ("second", second))
        }
        single_s, second_s = np.diff(times).tolist()
        return Passes(scans=drive.count, single_s=single_s, second_s=second_s, live=live, **errors)


def _errors(found: Trajectory, truth: Trajectory, anchor_ns: int, known: Inside | None) -> Errors:
    error = error_in_bim(found, truth)
    before = found.only(found.stamps_ns < anchor_ns)
    heights = found.positions[:, 2] - truth.at(found.stamps_ns)[:, 2, 3]
    return Errors(
        rmse_m=error.position.rmse, plan_view_m=error.horizontal.rmse,
        before_anchor_m=error_in_bim(before, truth).position.rmse if len(before) > 1 else None,
        height_m=float(np.abs(heights).mean()), worst_m=error.position.max, wrong=wrong_poses(found, truth),
        inside=known,
    )  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each cell of the design and each pass, and what the second pass gains and costs."""
    rows = named(rows)
    by = ["carrier", "effects", "sensor"]
    longer = pd.concat([_of_pass(rows, name, by) for name in ("live", "single", "second")])
    known = longer[longer["inside.poses"].notna()]
    return {
        "errors": grouped(longer, [*by, "result"], _cells), "gain": grouped(rows, ["carrier", "effects"], _gain),
        "regions": grouped(known, ["carrier", "effects", "result"], pooled),
    }  # fmt: skip


def _of_pass(rows: pd.DataFrame, name: str, by: list[str]) -> pd.DataFrame:
    own = rows[[*by, *(column for column in rows if column.startswith(f"{name}."))]]
    return own.rename(columns=lambda column: column.removeprefix(f"{name}.")).assign(result=name)


def _cells(own: pd.DataFrame) -> dict[str, str]:
    return {
        "anchored": of(own.rmse_m.notna().sum(), len(own)), "RMSE (m)": spread(own.rmse_m, ".3f"),
        "plan view (m)": spread(own.plan_view_m, ".3f"), "mean error in height (m)": spread(own.height_m, ".3f"),
        "worst (m)": spread(own.worst_m, ".2f"), "before the first anchor (m)": spread(own.before_anchor_m, ".3f"),
        "scans wrong": f"{own.wrong.sum():.0f}",
    }  # fmt: skip


def _gain(own: pd.DataFrame) -> dict[str, str]:
    both = own[own["single.rmse_m"].notna() & own["second.rmse_m"].notna()]
    single, second = both["single.rmse_m"], both["second.rmse_m"]
    return {
        "drives": str(len(both)), "mean RMSE, single (m)": f"{single.mean():.4f}",
        "mean RMSE, second (m)": f"{second.mean():.4f}", "better": of((second < single - NO_WORSE_M).sum(), len(both)),
        "worse": of((second > single + NO_WORSE_M).sum(), len(both)),
        "worse by more than a tenth and 5 mm": of((second > 1.1 * single + 0.005).sum(), len(both)),
        "CPU time of the second over the first": spread(both.second_s / both.single_s, ".2f"),
    }  # fmt: skip


STUDY = Study(
    "second_pass", "what a second pass over all scans gains, for any carrier, sensor and effect",
    anchored_carriers.Choice, anchored_carriers.STUDY.quick, CarriedCase, Passes, anchored_carriers.cases, measure,
    tables, small=True,
)  # fmt: skip
