"""Tables of the verdicts on elements, each by carrier and sensor."""

from collections.abc import Mapping

import pandas as pd

from evaluation.harness import Claim
from evaluation.harness.tables import coverage, grouped, of, rare, spread
from evaluation.metrics.as_built_scores import LEAST_VIEWS
from evaluation.studies.carried.carriers_tables import named
from evaluation.studies.carried.elements_truth import Judged
from sgslam.as_built.elements import SURE_SIGMAS

ENOUGH = 0.3  # of a wall seen, from which a verdict on it is expected
CLOSE_M = 0.005
GONE = ("absent", "filled")
MEASURED = {
    "wall": "walls", "door": "displaced openings", "window": "displaced openings", "column": "displaced columns",
}  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The drives; what became of walls, of absent walls and elements that stand, of doors, windows and columns, and of
    unplanned walls; and how true the offsets are."""
    rows = named(rows)
    elements = _elements(rows)
    is_wall = elements.element == "wall"
    by = ["carrier", "sensor"]
    measured = _measured(elements)
    return {
        "drives": grouped(rows, [*by, "cell"], _drives),
        "walls": grouped(elements[is_wall], [*by, "cell"], _walls),
        "absent": grouped(rows, by, _absent),
        "openings": grouped(elements[~is_wall], [*by, "element"], _others),
        "unplanned": grouped(rows[(rows.cell == "absent") & rows.rmse_m.notna()], by, _unplanned),
        "offsets": grouped(measured, [*by, "measured"], _offsets),
    }


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many moved and unplanned walls are found, and how many reports are false."""
    every = _elements(rows)
    walls = every[(every.element == "wall") & (every.verdict != "not seen") & (every.built != "absent")]
    expected, standing = walls.off & (walls.seen >= ENOUGH), every[~every.built.isin(GONE)]
    called = walls.verdict == "moved"
    cases = f"{len(rows)} drives, {rows['sequence.name'].nunique()} buildings"
    return [
        Claim("Walls moved by 15 or 30 mm that are called moved", of((called & expected).sum(), expected.sum()), cases),
        Claim(
            "Walls within the tolerance that are called moved",
            rare(int((called & ~walls.off).sum()), int((~walls.off).sum())), cases,
        ),
        Claim(
            "Elements seen that stand and are called absent",
            rare(int((standing.verdict == "absent").sum()), len(standing)), cases,
        ),
    ]  # fmt: skip


def _elements(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each element with a verdict; it is `off` its place if by more than the tolerance along the offset."""
    lines = rows[["carrier", "sensor", "cell", "tolerance_m", "judged"]].explode("judged").dropna(subset="judged")
    lines = lines.reset_index(drop=True)
    judged = pd.DataFrame(lines.judged.tolist(), columns=list(Judged.model_fields))
    lines = lines.drop(columns="judged").join(judged)
    return lines.assign(off=lines.true_m.abs() > lines.tolerance_m)


def _drives(own: pd.DataFrame) -> dict[str, str]:
    rmse = spread(1000 * own.rmse_m.astype(float))
    return {"anchored": of(own.rmse_m.notna().sum(), len(own)), "RMSE (mm)": rmse, "coverage": coverage(own)}


def _walls(own: pd.DataFrame) -> dict[str, str]:
    """How many of the walls that are seen got the right verdict, by how they were built."""
    seen = own[(own.verdict != "not seen") & (own.built != "absent")]
    called = seen.verdict == "moved"
    expected = seen.off & (seen.seen >= ENOUGH)
    elsewhere = (seen.built == "moved") & ~seen.off
    return {
        "moved": of((called & expected).sum(), expected.sum()),
        "measured only where they are not moved": str(elsewhere.sum()),
        "called moved, rightly": of((called & seen.off).sum(), called.sum()),
        "as planned, called moved": of((called & ~seen.off).sum(), (~seen.off).sum()),
        "called absent": of(((seen.verdict == "absent") & ~seen.off).sum(), (~seen.off).sum()),
    }


def _absent(own: pd.DataFrame) -> dict[str, str]:
    """Absent walls that were seen through, those that were not, and the elements of all drives that stand."""
    elements = _elements(own)
    visible = elements[(elements.element == "wall") & (elements.built == "absent") & (elements.views >= LEAST_VIEWS)]
    hidden = elements[(elements.element == "wall") & (elements.built == "absent") & (elements.views < LEAST_VIEWS)]
    standing = elements[~elements.built.isin(GONE)]
    not_seen = own.filter(items=["not_seen.as planned"]).sum().sum()  # no column where no drive is anchored
    return {
        "absent walls, called absent": of((visible.verdict == "absent").sum(), len(visible)),
        "called moved": of((visible.verdict == "moved").sum(), len(visible)),
        "not seen": of((visible.verdict == "not seen").sum(), len(visible)),
        "absent walls that were not seen through, called absent": of((hidden.verdict == "absent").sum(), len(hidden)),
        "elements that stand, called absent": of((standing.verdict == "absent").sum(), len(standing) + not_seen),
    }


def _others(own: pd.DataFrame) -> dict[str, str]:
    """What became of the doors, windows or columns that are seen."""
    seen = own[own.verdict != "not seen"]
    displaced, plain = seen[seen.built == "displaced"], seen[seen.built == "as planned"]
    filled, absent = seen[seen.built == "filled"], seen[seen.built == "absent"]
    wrong = plain.verdict.isin(["moved", "absent"])
    return {
        "displaced, called moved": of((displaced.verdict == "moved").sum(), len(displaced)),
        "filled, called absent": of((filled.verdict == "absent").sum(), len(filled)),
        "absent, called absent": of((absent.verdict == "absent").sum(), len(absent)),
        "as planned, called moved or absent": of(wrong.sum(), len(plain)),
        "uncertain": _share((seen.verdict == "uncertain").sum(), len(seen)),
    }


def _unplanned(own: pd.DataFrame) -> dict[str, str]:
    to_find, found, false, on_planned, m2 = own[
        [f"unplanned.{name}" for name in ("to_find", "found", "false", "on_planned", "m2")]
    ].sum()
    return {
        "drives": str(len(own)), "found": of(found, to_find), "false entries": f"{false:.0f}",
        "entries on planned walls": f"{on_planned:.0f}", "rooms entered (m2)": f"{m2:.0f}",
    }  # fmt: skip


def _measured(elements: pd.DataFrame) -> pd.DataFrame:
    """Walls that stand, and what was displaced, as far as measured."""
    known = elements[elements.offset_m.notna() & ~elements.built.isin(GONE)]
    known = known[(known.element == "wall") | (known.built == "displaced")]
    return known.assign(measured=known.element.map(MEASURED))


def _offsets(own: pd.DataFrame) -> dict[str, str]:
    """How true the offsets and their standard deviations are."""
    errors = (own.offset_m - own.true_m).abs().astype(float)
    inside = errors <= SURE_SIGMAS * own.sigma_m.astype(float)
    return {
        "number": str(len(own)), "median error (mm)": f"{1000 * errors.median():.1f}",
        "95 % (mm)": f"{1000 * errors.quantile(0.95):.1f}", "within 5 mm": _share((errors <= CLOSE_M).sum(), len(own)),
        "within two sigma": _share(inside.sum(), len(own)),
    }  # fmt: skip


def _share(part: int, whole: int) -> str:
    """As `of`, with the share in percent."""
    return f"{of(part, whole)} ({100 * part / whole:.0f} %)" if whole else ""
