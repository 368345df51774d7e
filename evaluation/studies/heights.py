"""Heights in the building: how far off they are, and whether their standard deviations say so."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import PositiveInt

from data.generation import DEMO_STOREYS
from evaluation.drive import DriveCase, DriveOptions, drive_of
from evaluation.run import described, outcome_of, study_of_runs
from evaluation.study import Claim, Record
from evaluation.tables import ANCHORED, Query, count, inside, made, mean, spread, units

LEVELS = ("office_902060", "apartment_902061", "corridor_902062", "l_shape_902063", "office_902064", "skewed_902065")
MOST_M, MOST_SIGMAS = 0.06, 3.0  # errors beyond which a drive is counted


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors`, as planned and with each of `effects` and of `plans` (what is wrong
    with the plan), in `per_cell` drives drawn in turn; with a flat plan in the buildings of `levels` alone. And tours
    of the storeys of the demo building by each carrier, with each of the seeds `climbs`."""

    buildings: tuple[str, ...] = ("institute", "office", "fzk-haus", "niedriha", "sample-house", "jesse")
    levels: tuple[str, ...] = tuple(f"levels/{building}" for building in LEVELS)
    climbs: tuple[int, ...] = (1, 2)
    seconds: float = 30.0
    carriers: tuple[str, ...] = ("wheeled", "handheld")
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32", "Mid-360")
    effects: tuple[tuple[str, ...], ...] = (("steps",), ("shelves", "people"))
    plans: tuple[str, ...] = ("low ceilings", "levels off")
    per_cell: PositiveInt = 3


def cases(options: Choice) -> list[DriveCase]:
    """Every cell of the design, in its drives."""
    wrong: list[dict[str, Any]] = [
        {},
        *({"effects": own} for own in options.effects),
        *({"trouble": own} for own in options.plans),
    ]
    cells: list[dict[str, Any]] = [
        {"carrier": carrier, "sensor": sensor, **own}
        for own, carrier, sensor in product(wrong, options.carriers, options.sensors)
    ]
    every = options.model_copy(update={"buildings": (*options.buildings, *options.levels)})
    own = options.model_copy(update={"buildings": options.levels})
    flat = [{"carrier": c, "sensor": s, "trouble": "flat plan"} for c, s in product(options.carriers, options.sensors)]
    drives = [*every.in_turn(cells, options.per_cell), *own.in_turn(flat, options.per_cell)]
    tours = [
        DriveCase(building=f"levels/demo_{seed}", storeys=DEMO_STOREYS, seconds=None, carrier=carrier, seed=seed)
        for seed in options.climbs
        for carrier in options.carriers
    ]
    return [*(DriveCase(**design) for design in drives), *tours]


def measure(case: DriveCase, work: Path) -> Record:
    """All measures of the run, the mean error in height and the largest, and the first in standard deviations."""
    outcome = outcome_of(case, work)
    record = described(case) | outcome.measures() | {"rooms": len(drive_of(case, work).rooms)}
    if len(outcome.anchored):
        at = outcome.anchored.stamps_ns
        off = outcome.anchored.positions[:, 2] - outcome.truth.at(at)[:, 2, 3]
        sigma = outcome.sigma[np.isin(outcome.stamps_ns, at), 2]
        record |= {"mean_z_m": abs(float(off.mean())), "z_sigma_m": float(np.median(sigma))}
        record["z_sigmas"] = abs(float((off / sigma).mean()))
    return record


COLUMNS = {
    "anchored": ANCHORED["anchored"],
    "mean error (m)": spread("mean_z_m", ".3f"),
    "its sigma (m)": spread("z_sigma_m", ".3f"),
    "in its 95 % region (%)": inside("height"),
    "over 0.06 m": count(lambda rows: rows.mean_z_m > MOST_M),
    "over 3 sigmas": count(lambda rows: rows.z_sigmas > MOST_SIGMAS),
}
QUERIES = {"conditions": Query({"condition": "condition"}, COLUMNS)}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """By what differs from the plan."""
    condition = rows.trouble.where(rows.trouble.ne(""), rows.effects)
    return made(QUERIES, rows.assign(condition=condition.where(rows.storeys.str.len().le(1), "over stairs")))


def claims(rows: pd.DataFrame) -> list[Claim]:
    """The mean error in height."""
    anchored = rows[rows.mean_z_m.notna()]
    return [Claim("Mean error in height (m)", mean("mean_z_m")(anchored), units(anchored))]


QUICK = Choice(buildings=("niedriha",), climbs=(1,), sensors=("VLP-16",), per_cell=1)
STUDY = study_of_runs("heights", "how far off heights are", QUICK, cases, tables, claims, measure=measure)
