"""How well each scan is tracked without a plan, for any carrier, mount, sensor and effect, beside KISS-ICP and
small_gicp on the same scans."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from pydantic import Field

from evaluation.buildings import generated
from evaluation.drive import RECORDING, Degrees, DriveCase, DriveOptions
from evaluation.run import study_of_runs
from evaluation.study import Claim
from evaluation.tables import Column, Query, count, made, of, rare, share, spread, spread_of, total, units

OURS, PEERS = "tracking", ("KISS-ICP", "small_gicp")
TRACKED_M = 0.1  # ATE up to which a drive counts as tracked
WORSE_M = 0.02  # ATE by which ours may be worse than the better of the others
HAND = "handheld"


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors`; on a hand each of `effects`, and all of them with each sensor; each of
    `mounts` (roll, pitch, yaw in degrees) on a robot; the recorded hand at each of `paces` without the points' times.
    Each in `per_cell` drives drawn in turn (all of them for None)."""

    buildings: tuple[str, ...] = (
        *("demo", "institute", "office", "basement", "house-1", "house-2"),
        *generated(40),
    )
    carriers: tuple[str, ...] = ("wheeled", HAND, "pole", RECORDING)
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32", "OS1-64", "XT32", "Mid-360", "sector")
    effects: tuple[str, ...] = ("glass", "people", "doors", "shelves", "tolerance", "returns", "steps")
    mounts: tuple[Degrees, ...] = ((0.0, 12.0, 0.0), (0.0, 40.0, 0.0), (180.0, 0.0, 0.0), (0.0, 90.0, 0.0))
    paces: tuple[float, ...] = (1.0, 2.0, 4.0)
    per_cell: int | None = Field(4, ge=1)


def cases(options: Choice) -> list[DriveCase]:
    """Every cell of the design, in its drives, by each method."""
    return [
        DriveCase(**design, variant=variant)
        for design in options.in_turn(list(_cells(options)), options.per_cell)
        for variant in (OURS, *PEERS)
    ]


def _cells(options: Choice) -> Iterator[dict[str, Any]]:
    """The fields of each cell that differ from their defaults."""
    for carrier, sensor in product(options.carriers, options.sensors):
        yield {"carrier": carrier, "sensor": sensor}
    for effect in options.effects:
        yield {"carrier": HAND, "effects": (effect,)}
    for sensor in options.sensors:
        yield {"carrier": HAND, "sensor": sensor, "effects": ("all",)}
    for mount in options.mounts:
        yield {"mount_deg": mount}
    for pace in options.paces:
        yield {"carrier": RECORDING, "pace": pace, "times": False}


def _of(method: str) -> Column:
    """The ATE of a method: median, least and largest."""
    return lambda rows: spread_of(rows[rows.variant == method].ate, ".3f")


CELL: dict[str, Column] = {
    "drives": lambda rows: str(rows.drive.nunique()),
    **{f"{method}: ATE (m)": _of(method) for method in (OURS, *PEERS)},
    "ours over the better peer": lambda rows: spread_of(_both(rows).ratio, ".2f"),
    "tracked": lambda rows: of((_both(rows).ours <= TRACKED_M).sum(), len(_both(rows))),
    "by the better peer": lambda rows: of((_both(rows).peer <= TRACKED_M).sum(), len(_both(rows))),
}
LEVEL, PLAIN = "0, 0, 0", "none"
QUERIES = {
    "carriers": Query({"carrier": "carrier", "sensor": "sensor"}, CELL, lambda rows: rows.condition.eq(PLAIN)),
    "conditions": Query({"carrier": "carrier", "condition": "condition"}, CELL, lambda rows: rows.condition.ne(PLAIN)),
    "methods": Query(
        {"variant": "method"},
        {
            "drives": count(),
            "ATE (m)": lambda rows: spread_of(rows.ate, ".3f"),
            "over a second (m)": spread("second_m", ".3f"),
            "over a second (deg)": spread("second_deg", ".2f"),
            "worst step (m)": spread("worst_step_m", ".2f"),
            "scans a second of CPU": spread("scans_per_s"),
        },
    ),
    "reliability": Query(
        {"carrier": "carrier"},
        {
            "drives": count(),
            "good (%)": share("good_scans", "scans"),
            "lost (%)": share("lost", "scans"),
            "in its 95 % region, over a second (%)": share("inside_motions", "reliability.motions"),
            "called good, and wrong": total("reliability.wrongly_good", "scans"),
            "up (deg)": spread("reliability.up_deg", ".2f"),
            "drives with a false kidnapping": count(lambda rows: rows.kidnaps > 0),
        },
        lambda rows: rows.variant.eq(OURS),
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """By carrier and sensor; by effects, mount or points without times; all errors by method; and whether what our
    tracker says of its poses is true."""
    return made(QUERIES, _prepared(rows))


def _prepared(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the ATE as `ate`, infinite for a tracker that is lost, with counts for the shares, and with what
    makes the drive harder as `condition`."""
    known = rows.reindex(columns=[*rows, *(set(RELIABILITY) - set(rows))])
    condition = known.effects.where(known.effects.ne(PLAIN), "")
    condition = condition.where(known["mount"].eq(LEVEL), "mount at " + known["mount"] + " deg")
    condition = condition.where(known.times.astype(bool), "points without times")
    return known.assign(
        condition=condition.replace("", PLAIN),
        ate=known.odometry_ate_m.astype(float).fillna(np.inf),
        good_scans=known["reliability.good"].astype(float) * known.scans,
        inside_motions=known["reliability.inside_95"].astype(float) * known["reliability.motions"].astype(float),
    )


RELIABILITY = tuple(f"reliability.{name}" for name in ("good", "inside_95", "motions", "wrongly_good", "up_deg"))


def _both(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each drive: the ATE of ours and of the better of the others, and their ratio."""
    key = rows.drive + rows.times.astype(str)
    wide = rows.assign(key=key).pivot_table(index="key", columns="variant", values="ate", aggfunc="first")
    wide = wide.reindex(columns=[OURS, *PEERS]).dropna(subset=[OURS])
    both = pd.DataFrame({"ours": wide[OURS], "peer": wide[list(PEERS)].min(axis=1)}).dropna()
    return both.assign(ratio=both.ours / both.peer)


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How the error without a plan compares with that of the better odometry, and false kidnappings."""
    rows = _prepared(rows)
    ours, over = rows[rows.variant == OURS], units(rows)
    text = "ATE without a plan, relative to the better of KISS-ICP and small_gicp (median, least, most)"
    kidnaps = rare(ours.kidnaps > 0, ours.building, "passes")
    return [
        Claim(text, spread_of(_both(rows).ratio, ".2f"), over),
        Claim("Passes over a drive without a kidnapping that report one", kidnaps, over),
    ]


QUICK = Choice(
    buildings=("institute", "house-1", *generated(40)[:3]),
    carriers=("wheeled", HAND, RECORDING),
    sensors=("VLP-16", "Mid-360"),
    effects=(),
    mounts=((0.0, 40.0, 0.0),),
    paces=(1.0,),
    per_cell=5,
    seconds=15.0,
)
STUDY = study_of_runs(
    "carriers", "how well each scan is tracked without a plan, for any carrier", QUICK, cases, tables, claims
)
