"""Tours over several storeys, and starts on each storey: whether the storey is recognised, and how soon."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict

from data.generation import DEMO_STOREYS
from evaluation.buildings import plan_graph
from evaluation.drive import DriveCase, drive_of
from evaluation.run import described, outcome_of, study_of_runs
from evaluation.study import Claim, Options, Record
from evaluation.tables import ANCHORED, ERRORS, EVER_WRONG, Query, count, made, rare, spread, truth, units

ON_STAIRS_M = 0.15  # height of the ground above or below the nearest storey
INSTITUTE = ("Keller", "Erdgeschoss", "1. Obergeschoss", "2. Obergeschoss", "Dachgeschoss")


class Tour(BaseModel):
    """Storeys of a building, in this order, and who carries the sensor."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    building: str = "demo"
    storeys: tuple[str, ...]
    seeds: tuple[int, ...] = (0, 1, 2)
    carriers: tuple[str, ...] = ("wheeled",)


class Choice(Options):
    """`climbs` are whole tours over their storeys; `starts` are drives of `seconds` on each of their storeys."""

    climbs: tuple[Tour, ...] = (
        Tour(storeys=DEMO_STOREYS, carriers=("wheeled", "handheld", "pole")),
        Tour(building="institute", storeys=INSTITUTE[1:3], carriers=("wheeled", "handheld", "pole")),
        Tour(building="institute", storeys=(*INSTITUTE[1:3], INSTITUTE[1]), seeds=(0, 1)),
    )
    starts: tuple[Tour, ...] = (Tour(building="institute", storeys=INSTITUTE, seeds=(0, 1, 2, 3, 4)),)
    seconds: float = 60.0


def cases(options: Choice) -> list[DriveCase]:
    """The tours over several storeys, then the starts on each."""
    chosen: list[tuple[Tour, tuple[str, ...], float | None]] = [(tour, tour.storeys, None) for tour in options.climbs]
    chosen += [(tour, (storey,), options.seconds) for tour in options.starts for storey in tour.storeys]
    return [
        DriveCase(building=tour.building, storeys=storeys, seconds=seconds, carrier=carrier, seed=seed)
        for tour, storeys, seconds in chosen
        for carrier in tour.carriers
        for seed in tour.seeds
    ]


def measure(case: DriveCase, work: Path) -> Record:
    """All measures of the run, the error on the stairs, and metres and rooms up to the first anchor."""
    outcome, drive = outcome_of(case, work), drive_of(case, work)
    record = described(case) | outcome.measures()
    truth_at = outcome.truth.at(outcome.anchored.stamps_ns)
    error = np.linalg.norm(outcome.anchored.positions - truth_at[:, :3, 3], axis=1)
    levels = np.array([f.elevation for f in plan_graph(drive.plan).floors if f.elevation is not None])
    stair = np.abs(truth_at[:, 2, 3, None] - drive.height_m - levels).min(axis=1) > ON_STAIRS_M
    record["stair_rmse_m"] = float(np.sqrt(np.mean(error[stair] ** 2))) if stair.any() else None
    if record["first_anchor_s"] is not None:
        steps = np.linalg.norm(np.diff(outcome.truth.positions, axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        seconds = (outcome.truth.stamps_ns - outcome.truth.stamps_ns[0]) / 1e9
        record["first_anchor_m"] = float(np.interp(record["first_anchor_s"], seconds, way))
        record["first_anchor_rooms"] = len({room for room, at in drive.rooms if at <= record["first_anchor_s"]})
    return record


QUERIES = {
    "climbs": Query(
        {"building": "building", "tour": "storeys", "carrier": "carrier"},
        {
            **ANCHORED,
            "height (m)": ERRORS["height (m)"],
            "on stairs (m)": spread("stair_rmse_m", ".3f"),
            "worst (m)": spread("worst_m", ".2f"),
            "floors": spread("floors"),
            "wrong storey": count(lambda rows: truth(rows, "wrong_storey")),
            **EVER_WRONG,
        },
        lambda rows: rows.climbs,
    ),
    "starts": Query(
        {"building": "building", "tour": "storey"},
        {
            **ANCHORED,
            "rooms until anchored": spread("first_anchor_rooms"),
            "metres until anchored": spread("first_anchor_m"),
            "ambiguous": count(lambda rows: rows.match_status.eq("ambiguous") & ~truth(rows, "anchored")),
            "wrong storey": count(lambda rows: truth(rows, "wrong_storey")),
            **EVER_WRONG,
        },
        lambda rows: ~rows.climbs,
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each tour over several storeys, and for each storey over its starts."""
    rows = rows.reindex(columns=list(dict.fromkeys([*rows, "first_anchor_rooms", "first_anchor_m"])))
    return made(QUERIES, rows.assign(climbs=rows.storeys.str.len() > 1, tour=rows.storeys.str.join(", ")))


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a storey was wrong."""
    wrong = rare(truth(rows, "wrong_storey"), rows.building)
    return [Claim("Runs that were ever anchored to a wrong storey", wrong, units(rows))]


QUICK = Choice(
    climbs=(
        Tour(storeys=DEMO_STOREYS, seeds=(0,), carriers=("wheeled", "handheld", "pole")),
        Tour(building="institute", storeys=INSTITUTE[1:3], seeds=(0,), carriers=("handheld",)),
    ),
    starts=(Tour(building="institute", storeys=INSTITUTE, seeds=(0,)),),
    seconds=45.0,
)
STUDY = study_of_runs(
    "storeys",
    "whether the storey is recognised, and how accurate a drive over stairs is",
    QUICK,
    cases,
    tables,
    claims,
    measure=measure,
)
