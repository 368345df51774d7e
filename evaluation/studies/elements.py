"""Whether the verdicts on elements are true, in buildings that differ from their plan."""

from collections.abc import Mapping
from itertools import product

import pandas as pd

from evaluation.conditions import BUILDING
from evaluation.drive import DriveCase, DriveOptions
from evaluation.elements import LEAST_VIEWS, Judged
from evaluation.run import TOLERANCE_M, study_of_runs
from evaluation.study import Claim
from evaluation.tables import ANCHORED, Column, Query, made, of, rare, total, units
from sgslam.as_built.elements import SURE_SIGMAS

ENOUGH = 0.3  # of a wall seen, from which a verdict on it is expected
GONE = ("absent", "filled")
EFFECTS = {"absent": ("shelves",)}  # in whose buildings something stands before the walls


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors` in each building with each of `changes`, and more `effects`."""

    buildings: tuple[str, ...] = ("fzk-haus", "niedriha", "jesse", "sample-house", "institute", "office", "demo")
    carriers: tuple[str, ...] = ("wheeled", "handheld", "pole")
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32")
    changes: tuple[str, ...] = tuple(BUILDING)
    effects: tuple[str, ...] = ()
    seconds: float = 70.0


def cases(options: Choice) -> list[DriveCase]:
    """Each drive with each building."""
    return [
        DriveCase(
            **drive,
            carrier=carrier,
            sensor=sensor,
            changes=changes,
            effects=tuple(dict.fromkeys((*EFFECTS.get(changes, ()), *options.effects))),
        )
        for drive, carrier, sensor, changes in product(
            options.drives(), options.carriers, options.sensors, options.changes
        )
    ]


def _verdict(verdict: str, built: str) -> Column:
    """How many of the elements built so got this verdict."""
    return lambda rows: of(rows[rows.built == built].verdict.eq(verdict).sum(), (rows.built == built).sum())


def _moved(rows: pd.DataFrame) -> str:
    expected = rows[rows.off & (rows.seen >= ENOUGH)]
    return of(expected.verdict.eq("moved").sum(), len(expected))


def _offset(rows: pd.DataFrame) -> str:
    errors = 1000 * rows.error_m.dropna()
    return f"{errors.median():.1f} ({errors.quantile(0.95):.0f})" if len(errors) else ""


def _sure(rows: pd.DataFrame) -> str:
    known = rows.dropna(subset=["error_m", "sigma_m"])
    return of((known.error_m <= SURE_SIGMAS * known.sigma_m.astype(float)).sum(), len(known))


WALLS: dict[str, Column] = {
    "moved, called moved": _moved,
    "as planned, called moved": lambda rows: of(rows[~rows.off].verdict.eq("moved").sum(), (~rows.off).sum()),
    "as planned, called absent": lambda rows: of(rows[~rows.off].verdict.eq("absent").sum(), (~rows.off).sum()),
    "offset error, median (95 %) in mm": _offset,
    "within two sigma": _sure,
}
OTHERS: dict[str, Column] = {
    "displaced, called moved": _verdict("moved", "displaced"),
    "filled, called absent": _verdict("absent", "filled"),
    "absent, called absent": _verdict("absent", "absent"),
    "as planned, called moved": _verdict("moved", "as planned"),
    "as planned, called absent": _verdict("absent", "as planned"),
    "uncertain": lambda rows: of(rows.verdict.eq("uncertain").sum(), len(rows)),
}
RUNS = {
    "runs": Query({"changes": "changes"}, ANCHORED),
    "unplanned": Query(
        {"carrier": "carrier", "sensor": "sensor"},
        {
            "found": total("unplanned.found", "unplanned.to_find"),
            "false entries": lambda rows: f"{rows['unplanned.false'].sum():.0f}",
            "entries on planned walls": lambda rows: f"{rows['unplanned.on_planned'].sum():.0f}",
        },
        lambda rows: rows.changes.eq("absent") & rows["unplanned.to_find"].notna(),
    ),
}
ELEMENTS = {
    "walls": Query(
        {"carrier": "carrier", "changes": "changes"},
        WALLS,
        lambda rows: rows.element.eq("wall") & rows.verdict.ne("not seen") & rows.built.ne("absent"),
    ),
    "absent_walls": Query(
        {"visible": "absent walls"},
        {name: _verdict(name, "absent") for name in ("absent", "moved", "uncertain", "not seen")},
        lambda rows: rows.element.eq("wall") & rows.built.eq("absent"),
    ),
    "openings": Query(
        {"element": "element"}, OTHERS, lambda rows: rows.element.ne("wall") & rows.verdict.ne("not seen")
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The runs; walls; absent walls, seen through by three keyframes or not; doors, windows and columns; and walls that
    are not planned."""
    return {**made(RUNS, rows), **made(ELEMENTS, elements_of(rows))}


def elements_of(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each element with a verdict; it is `off` its place if by more than the tolerance along the offset."""
    lines = rows[["building", "drive", "carrier", "sensor", "changes", "judged"]].explode("judged")
    lines = lines.dropna(subset="judged").reset_index(drop=True)
    judged = pd.DataFrame(lines.judged.tolist(), columns=list(Judged.model_fields))
    lines = lines.drop(columns="judged").join(judged)
    visible = (lines.views >= LEAST_VIEWS).map({True: "seen through", False: "not seen through"})
    stands = ~lines.built.isin(GONE) & (lines.element.eq("wall") | lines.built.eq("displaced"))
    error = (lines.offset_m.astype(float) - lines.true_m).abs().where(stands)
    return lines.assign(off=lines.true_m.abs() > TOLERANCE_M, visible=visible, error_m=error)


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many moved walls are found, and how many verdicts are false."""
    every = elements_of(rows)
    walls = every[every.element.eq("wall") & every.verdict.ne("not seen") & every.built.ne("absent")]
    small = walls[walls.off & (walls.seen >= ENOUGH) & walls.changes.isin(["15 mm", "30 mm"])]
    still, standing = walls[~walls.off], every[~every.built.isin(GONE) & every.verdict.ne("not seen")]
    over, found = units(rows), of(small.verdict.eq("moved").sum(), len(small))
    moved = rare(still.verdict.eq("moved"), still.building, "walls")
    absent = rare(standing.verdict.eq("absent"), standing.building, "elements")
    return [
        Claim("Walls moved by 15 or 30 mm that are called moved", found, over),
        Claim("Walls within 10 mm that are called moved", moved, over),
        Claim("Elements that stand and were seen, and are called absent", absent, over),
    ]


QUICK = Choice(
    buildings=("fzk-haus", "niedriha", "jesse", "sample-house", "institute"),
    carriers=("wheeled",),
    sensors=("VLP-16",),
    seconds=40.0,
)
STUDY = study_of_runs(
    "elements", "whether the verdicts on walls, openings and columns are true", QUICK, cases, tables, claims
)
