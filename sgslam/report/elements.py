"""What the report says of the elements, planned or not: names, counts, table, outlines in the plan.

Entries are those of elements.json, where unplanned walls have the same form (`shown_as_element`).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor
from sgslam.as_built.deviation_bands import UNPLANNED, signed_mm
from sgslam.report.number_formats import NOTHING

Array = NDArray[np.float64]
Entry = Mapping[str, Any]  # of elements.json
VERDICTS = ("moved", "absent", UNPLANNED, "uncertain", "as planned", "not seen")  # what needs a look comes first
_SPREAD_OUT = ("IfcSlab", "IfcCovering")  # they lie under or over everything else in plan view


def element_name(entry: Entry) -> str:
    """The element's name in the model; its kind where it has none."""
    return str(entry["name"]).strip() or f"{kind(entry['ifc_class'])} without a name"


def kind(ifc_class: str) -> str:
    """`Wall` of IfcWallStandardCase, `Curtain wall` of IfcCurtainWall."""
    words = re.findall(r"[A-Z][a-z]*", ifc_class.removeprefix("Ifc").removesuffix("StandardCase"))
    return " ".join(words).capitalize() if words else ifc_class


def is_spread_out(ifc_class: str) -> bool:
    """Whether an element covers others in plan view, as slabs do."""
    return ifc_class.startswith(_SPREAD_OUT)


def slug(verdict: str) -> str:
    """A verdict as part of a CSS class."""
    return verdict.replace(" ", "-")


@dataclass(frozen=True)
class DrawnElement:
    """`outline` (K, 2) in the BIM frame, not closed. `flat`: it lies under or over everything else, as slabs do."""

    global_id: str
    outline: Array
    verdict: str
    title: str
    flat: bool


def drawn_elements(entries: Sequence[Entry], floor: Floor | None) -> tuple[DrawnElement, ...]:
    """The elements of a storey, all where it is None; `entries` are those of elements.json."""
    return tuple(
        DrawnElement(
            entry["global_id"], np.array(entry["outline"], dtype=float), entry["verdict"], _title(entry),
            is_spread_out(entry["ifc_class"]),
        )
        for entry in entries
        if len(entry["outline"]) >= 3
        and (floor is None or entry["storey"] in (floor.id, floor.name))
    )  # fmt: skip


def _title(entry: Entry) -> str:
    return f"{element_name(entry)} ({kind(entry['ifc_class'])}): {entry['verdict']}\n{entry['reason']}"


COLUMNS = (
    "Element", "Kind", "Storey", "Rooms", "Verdict", "Offset", "Sigma", "LOA", "DIN 18202", "Seen", "Reason"
)  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """`sort` orders the column by numbers; None where the text does, and for a cell without a value."""

    text: str
    sort: float | None = None


@dataclass(frozen=True)
class ElementRow:
    """One element; `cells` are as many as COLUMNS."""

    global_id: str
    verdict: str
    cells: tuple[Cell, ...]


def element_rows(entries: Sequence[Entry]) -> list[ElementRow]:
    """The rows: what needs a look first, in the order of VERDICTS, the largest offset first."""
    ranked = sorted(entries, key=lambda e: (VERDICTS.index(e["verdict"]), -abs(e["offset_m"] or 0.0)))
    return [ElementRow(entry["global_id"], entry["verdict"], _cells(entry)) for entry in ranked]


def verdict_counts(entries: Sequence[Entry]) -> dict[str, int]:
    """The number of elements with each verdict, in the order of VERDICTS."""
    return {verdict: sum(entry["verdict"] == verdict for entry in entries) for verdict in VERDICTS}


def coverage(entries: Sequence[Entry]) -> float:
    """The share of the planned elements that were seen."""
    return 1 - verdict_counts(entries)["not seen"] / max(planned_count(entries), 1)


def planned_count(entries: Sequence[Entry]) -> int:
    """The number of planned elements."""
    return sum(entry["verdict"] != UNPLANNED for entry in entries)


def _cells(entry: Entry) -> tuple[Cell, ...]:
    verdict = entry["verdict"]
    shown = verdict if entry["conclusive"] or verdict in ("not seen", "uncertain") else f"{verdict}, not conclusive"
    offset, sigma = entry["offset_m"], entry["sigma_m"]
    return (
        Cell(element_name(entry)),
        Cell(kind(entry["ifc_class"])),
        Cell(", ".join(filter(None, (entry["storey"], entry.get("grid")))) or NOTHING),
        Cell(", ".join(entry["rooms"]) or NOTHING),
        Cell(shown, VERDICTS.index(verdict)),
        Cell(NOTHING) if offset is None else Cell(signed_mm(offset), abs(offset)),
        Cell(NOTHING) if sigma is None else Cell(f"{1000 * sigma:.1f} mm", sigma),
        Cell(entry["loa"] or NOTHING),
        Cell(entry["din_18202"] or NOTHING),
        Cell(NOTHING) if verdict in ("not seen", UNPLANNED) else Cell(f"{100 * entry['seen']:.0f} %", entry["seen"]),
        Cell(entry["reason"]),
    )


_DRAWN = 0.1  # m, the thickness of an unplanned wall in the plan


def shown_as_element(wall: Entry) -> dict[str, Any]:
    """An entry of `unplanned` in elements.json, in the form of an entry of `elements`."""
    low, high = wall["height_m"]
    behind = -_DRAWN * np.array(wall["facing"])
    first, last = np.array(wall["trace"])
    nothing = dict.fromkeys((
        "offset_m", "direction", "sigma_m", "loa", "turn_rad", "turn_sigma_rad", "din_18202_limit_m", "din_18202",
        "seen", "views",
    ))  # fmt: skip
    return {
        **nothing, "global_id": wall["id"], "name": f"{wall['length_m']:.1f} m, not planned", "ifc_class": "IfcWall",
        "storey": wall["storey"], "rooms": [wall["room"]] if wall["room"] else [], "verdict": UNPLANNED,
        "conclusive": True, "reason": f"{wall['length_m']:.1f} m long, z {low:.2f} to {high:.2f} m; {wall['reason']}",
        "outline": [place.tolist() for place in (first, last, last + behind, first + behind)], "grid": "",
    }  # fmt: skip
