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
SMALL = ("15 mm", "30 mm")
FURNITURE = ("shelves", "people", "doors")  # the effects of a furnished building
PER_M2 = 200.0  # of the floors of visited rooms, over which false entries are counted


MODELS = ("fzk-haus", "niedriha", "jesse", "sample-house")
GENERATED = ("walls/apartment_902701", "walls/l_shape_902702", "walls/office_902703", "walls/corridor_902704")


class Choice(DriveOptions):
    """Each of `carriers` with each of `sensors` in each building with each of `changes`, `furnished` or not."""

    buildings: tuple[str, ...] = (*MODELS, *GENERATED, "institute", "office", "demo")
    carriers: tuple[str, ...] = ("wheeled", "handheld", "pole")
    sensors: tuple[str, ...] = ("VLP-16", "OS0-32")
    changes: tuple[str, ...] = tuple(BUILDING)
    furnished: tuple[bool, ...] = (False, True)
    seconds: float = 70.0


def cases(options: Choice) -> list[DriveCase]:
    """Each drive with each building."""
    return [
        DriveCase(**drive, carrier=carrier, sensor=sensor, changes=changes, effects=FURNITURE if furnished else ())
        for drive, carrier, sensor, changes, furnished in product(
            options.drives(), options.carriers, options.sensors, options.changes, options.furnished
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


def _per_area(rows: pd.DataFrame, field: str) -> str:
    return f"{PER_M2 * rows[field].sum() / max(rows['visited_m2'].sum(), 1.0):.2f}"


RUNS = {
    "runs": Query({"furnished": "furnished"}, ANCHORED),
    "unplanned": Query(
        {"furnished": "furnished"},
        {
            "found": total("unplanned.found", "unplanned.to_find"),
            "false entries": lambda rows: f"{rows['unplanned.false'].sum():.0f}",
            f"the same per {PER_M2:.0f} m²": lambda rows: _per_area(rows, "unplanned.false"),
            "entries on planned walls": lambda rows: f"{rows['unplanned.on_planned'].sum():.0f}",
        },
        lambda rows: rows["unplanned.to_find"].notna(),
    ),
}
ELEMENTS = {
    "walls": Query(
        {"furnished": "furnished", "changes": "changes"},
        WALLS,
        lambda rows: rows.element.eq("wall") & rows.verdict.ne("not seen") & rows.built.ne("absent"),
    ),
    "absent_walls": Query(
        {"visible": "absent walls"},
        {name: _verdict(name, "absent") for name in ("absent", "moved", "uncertain", "not seen")},
        lambda rows: rows.element.eq("wall") & rows.built.eq("absent"),
    ),
    "openings": Query(
        {"element": "element"},
        OTHERS,
        lambda rows: rows.element.ne("wall") & rows.verdict.ne("not seen"),
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The runs; walls; absent walls, seen through by three keyframes or not; doors, windows and columns; and walls that
    are not planned."""
    rows = rows.assign(furnished=_furnished(rows))
    return {**made(RUNS, rows), **made(ELEMENTS, elements_of(rows))}


def _furnished(rows: pd.DataFrame) -> "pd.Series[str]":
    return rows.effects.map(lambda effects: "yes" if all(name in effects for name in FURNITURE) else "no")


def elements_of(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each element with a verdict; it is `off` its place if by more than the tolerance along the offset."""
    rows = rows.assign(furnished=_furnished(rows))
    lines = rows[["building", "drive", "carrier", "sensor", "changes", "furnished", "judged"]].explode("judged")
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
    small = walls[walls.off & (walls.seen >= ENOUGH) & walls.changes.isin(SMALL)]
    still, standing = walls[~walls.off], every[~every.built.isin(GONE) & every.verdict.ne("not seen")]
    gone = every[every.element.eq("wall") & every.built.eq("absent") & every.visible.eq("seen through")]
    over = units(rows)
    moved = rare(still.verdict.eq("moved"), still.building, "walls")
    absent = rare(standing.verdict.eq("absent"), standing.building, "elements")
    return [
        Claim(
            "Walls moved by 15 or 30 mm that are called moved", of(small.verdict.eq("moved").sum(), len(small)), over
        ),
        Claim("Walls within 10 mm that are called moved", moved, over),
        Claim("Elements that stand and were seen, and are called absent", absent, over),
        Claim("Absent walls that were seen through, and are called absent", _share(gone, "absent"), over),
        Claim("Unplanned walls that are found", total("unplanned.found", "unplanned.to_find")(rows), over),
    ]


def _share(rows: pd.DataFrame, verdict: str) -> str:
    return of(rows.verdict.eq(verdict).sum(), len(rows))


QUICK = Choice(buildings=(*MODELS, *GENERATED), sensors=("VLP-16",), furnished=(False,), seconds=45.0)
STUDY = study_of_runs(
    "elements", "whether the verdicts on walls, openings and columns are true", QUICK, cases, tables, claims
)
