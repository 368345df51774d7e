"""How far off the truth a run is in building coordinates, with parts of the system left out or replaced, and its peers.

On a robot and in a hand, in buildings as planned and with a third of their walls 10 to 30 cm off. The headline table is
of buildings by which no setting was chosen.
"""

from collections.abc import Mapping
from itertools import product

import pandas as pd

from evaluation.buildings import building_named, generated
from evaluation.drive import DriveCase, DriveOptions
from evaluation.metrics.statistics import ratio
from evaluation.run import study_of_runs
from evaluation.study import Claim
from evaluation.tables import (
    ANCHORED,
    ERRORS,
    INSIDE,
    Query,
    count,
    interval,
    made,
    mean,
    of,
    often,
    over_buildings,
    spread,
    truth,
    units,
)

LABELS = {
    "KISS-ICP": "KISS-ICP alone",
    "small_gicp": "small_gicp alone",
    "ICP to the BIM": "each scan to the BIM by ICP",
    "unanchored": "ours without the plan",
    "published": "ours, the published matcher",
    "voting": "ours, voting matcher",
    "anchored": "**ours**",
    "oracle": "ours, true matches",
}
MOVED = "10 to 30 cm"
HAND = "handheld"
HOUSES = ("fzk-haus", "niedriha", "house-1", "house-2", "sample-house", "jesse")


class Choice(DriveOptions):
    """Each of `variants` and `parts` (a part of the system left out) with each of `carriers`, the `parts` also in IFC
    models whose walls are moved; `replaced` (a part replaced, or a front end that drifts) with the first carrier."""

    buildings: tuple[str, ...] = (*generated(0, 1, 2), *HOUSES, "institute", "office", "basement", "demo")
    seeds: tuple[int, ...] = (0, 1)
    carriers: tuple[str, ...] = ("wheeled", HAND)
    variants: tuple[str, ...] = tuple(LABELS)
    parts: tuple[str, ...] = ("single pass", "no adjustment")
    replaced: tuple[str, ...] = (
        "walls only",
        "rooms only",
        "KISS-ICP inside",
        "small_gicp inside",
        "weakened, unanchored",
        "weakened, voting",
        "weakened",
    )
    seconds: float = 90.0


def cases(options: Choice) -> list[DriveCase]:
    """All variants of each drive."""
    found = []
    for drive, carrier in product(options.drives(), options.carriers):
        replaced = options.replaced if carrier == options.carriers[0] else ()
        variants = (*options.variants, *options.parts, *replaced)
        found += [DriveCase(**drive, carrier=carrier, variant=variant) for variant in variants]
        if building_named(drive["building"]).bim.endswith(".ifc"):
            variants = ("ICP to the BIM", *options.parts, "anchored")
            found += [DriveCase(**drive, carrier=carrier, changes=MOVED, variant=variant) for variant in variants]
    return found


def _is_main(rows: pd.DataFrame) -> "pd.Series[bool]":
    return rows.variant.isin(LABELS) & rows.changes.eq("")


MAP = {
    "runs": count(),
    "wall precision": mean("wall_precision", ".2f"),
    "wall recall": mean("wall_recall", ".2f"),
    "wall offset (mm)": spread("wall_offset_mm", ".1f"),
    "room recall": mean("room_recall", ".2f"),
    "match precision": mean("match_precision", ".3f"),
    "match recall": mean("match_recall", ".2f"),
    "first anchor (s)": spread("first_anchor_s"),
    **INSIDE,
}
ALL = {"anchored": ANCHORED["anchored"], "mean RMSE (m)": mean("rmse_m"), **ERRORS}
PARTS = {**ANCHORED, "RMSE, times the whole system's": lambda rows: _relative(rows)}
BY, BY_ROLE = {"carrier": "carrier", "variant": "variant"}, {"role": "buildings", "carrier": "carrier"}
QUERIES = {
    "errors": Query({**BY_ROLE, "variant": "variant"}, ALL, _is_main),
    "map": Query(BY_ROLE, MAP, lambda rows: rows.variant.eq("anchored") & _is_main(rows) & truth(rows, "anchored")),
    "parts": Query(BY, PARTS, lambda rows: ~_is_main(rows) & rows.changes.eq("")),
    "moved": Query(BY, ALL, lambda rows: rows.changes.eq(MOVED)),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """README's table, of test buildings; all errors; the map; parts left out; walls that are moved."""
    rows = _with_whole(rows).sort_values("carrier", ascending=False, kind="stable")
    headline = rows[_is_main(rows) & rows.role.eq("test")]
    lines = []
    for variant, label in LABELS.items():
        of_variant = headline[headline.variant == variant]
        cells = {carrier: _headline(part) for carrier, part in of_variant.groupby("carrier", sort=False)}
        if cells:
            titles = {"wheeled": "on a robot: RMSE (m)", HAND: "in a hand: RMSE (m)"}
            lines.append({"": label, **{titles.get(name, name): text for name, text in cells.items()}})
    return {"readme": pd.DataFrame(lines), **made(QUERIES, rows)}


def _headline(own: pd.DataFrame) -> str:
    """The mean RMSE of the anchored runs with its interval over buildings, and how many runs are anchored."""
    error = interval(over_buildings(own.rmse_m, own.building))
    anchored = own.anchored.eq(other=True)
    return error if anchored.all() else f"{error} ({of(anchored.sum(), len(own))} anchored)"


def _with_whole(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the RMSE of the whole system on the same drive as `whole_m`."""
    whole = rows[rows.variant == "anchored"][["drive", "rmse_m"]].rename(columns={"rmse_m": "whole_m"})
    return rows.merge(whole, on="drive", how="left")


def _relative(rows: pd.DataFrame) -> str:
    both = rows.dropna(subset=["rmse_m", "whole_m"])
    return interval(ratio(both.rmse_m.astype(float), both.whole_m.astype(float), both.building.tolist()), ".2f")


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many runs are anchored, and how exactly, on test buildings."""
    rows = rows[rows.role.eq("test") & rows.changes.eq("")]
    found = []
    for carrier, whole in rows[rows.variant == "anchored"].groupby("carrier", sort=False):
        rmse = interval(over_buildings(whole.rmse_m, whole.building), ".1f", 1000)
        anchored = often(truth(whole, "anchored"), whole.building)
        found += [
            Claim(f"{carrier}, from an unknown start: runs anchored", anchored, units(whole)),
            Claim(f"{carrier}: RMSE in building coordinates (mm)", rmse, units(whole)),
        ]
    return found


QUICK = Choice(
    buildings=(*generated(0)[:3], *HOUSES[:2]),
    seeds=(0,),
    replaced=("KISS-ICP inside", "weakened, unanchored", "weakened"),
    seconds=30.0,
)
STUDY = study_of_runs(
    "accuracy",
    "how far off the truth a run is in building coordinates, with parts of the system left out, and its peers",
    QUICK,
    cases,
    tables,
    claims,
)
