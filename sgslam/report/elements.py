"""What the report says of the elements, planned or not: names, counts, table, outlines in the plan.

Entries are those of elements.json, where unplanned walls have the same form (`shown_as_element`).
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor
from sgslam.as_built.deviation_bands import UNPLANNED, signed_mm
from sgslam.as_built.elements.tolerance_classes import DIN_18202
from sgslam.report.drawn_paths import Mark
from sgslam.report.number_formats import NOTHING

Array = NDArray[np.float64]
Entry = Mapping[str, Any]  # of elements.json
VERDICTS = ("moved", "absent", UNPLANNED, "uncertain", "as planned", "not seen")  # what needs a look comes first
_SPREAD_OUT = ("IfcSlab", "IfcCovering")  # they lie under or over everything else in plan view
_OPENINGS = ("IfcDoor", "IfcWindow")


def element_name(entry: Entry) -> str:
    """The element's name in the model; its kind where it has none."""
    return str(entry["name"]).strip() or f"{kind(entry['ifc_class'])} without a name"


def kind(ifc_class: str) -> str:
    """`Wall` of IfcWallStandardCase, `Curtain wall` of IfcCurtainWall."""
    words = re.findall(r"[A-Z][a-z]*", ifc_class.removeprefix("Ifc").removesuffix("StandardCase"))
    return " ".join(words).capitalize() if words else ifc_class


def tolerance_class(ifc_class: str) -> str:
    """The class of DIN_18202 that an element is in."""
    return "slab" if ifc_class.startswith(_SPREAD_OUT) else "opening" if ifc_class.startswith(_OPENINGS) else "wall"


def tolerance_presets(tolerance: float) -> dict[str, dict[str, str]]:
    """Tolerances (mm) by class and by what is on their button; the run's own, in metres, comes first."""
    own, named = f"{1000 * tolerance:g}", {kind: f"{1000 * limit:g}" for kind, limit in DIN_18202.items()}
    return {f"this run, {own} mm": dict.fromkeys(named, own), "DIN 18202": named}


def slug(verdict: str) -> str:
    """A verdict as part of a CSS class."""
    return verdict.replace(" ", "-")


def element_marks(entries: Sequence[Entry], floor: Floor | None) -> list[Mark]:
    """The elements of a storey, all where it is None, in the BIM frame; slabs, which cover others in plan view, come
    first and are `flat`."""
    marks = []
    for entry in entries:
        if len(entry["outline"]) < 3 or (floor is not None and entry["storey"] not in (floor.id, floor.name)):
            continue
        flat = ("flat",) if entry["ifc_class"].startswith(_SPREAD_OUT) else ()
        text = f"{element_name(entry)} ({kind(entry['ifc_class'])})\n{entry['verdict']}\n{entry['reason']}"
        looks = (f"verdict-{slug(entry['verdict'])}", *flat)
        outline = np.array(entry["outline"], dtype=float)
        marks.append(Mark(outline, text, True, looks, entry["global_id"]))
    return sorted(marks, key=lambda mark: "flat" not in mark.looks)


_OF_MODEL = ("Element", "Kind", "Storey", "Rooms")
_FOUND = ("Verdict", "Progress", "Tolerance", "Offset", "Sigma", "LOA", "DIN 18202", "Coverage", "Reason")
COLUMNS = _OF_MODEL + _FOUND
NUMBERS = ("Offset", "Sigma", "Coverage")
Cell = tuple[str, float | None]  # its text, and what orders the column: None where the text does, or there is nothing


def element_rows(entries: Sequence[Entry]) -> list[tuple[Entry, list[Cell]]]:
    """Each element with its cells: what needs a look first, in the order of VERDICTS, the largest offset first."""
    ranked = sorted(entries, key=lambda e: (VERDICTS.index(e["verdict"]), -abs(e["offset_m"] or 0.0)))
    return [(entry, _cells(entry)) for entry in ranked]


def verdict_counts(entries: Sequence[Entry]) -> dict[str, int]:
    """The number of elements with each verdict, in the order of VERDICTS."""
    return {verdict: sum(entry["verdict"] == verdict for entry in entries) for verdict in VERDICTS}


def _cells(entry: Entry) -> list[Cell]:
    offset, sigma, coverage = entry["offset_m"], entry["sigma_m"], entry["coverage"]
    cells: list[Cell] = [
        (element_name(entry), None),
        (kind(entry["ifc_class"]), None),
        (", ".join(filter(None, (entry["storey"], entry.get("grid")))), None),
        (", ".join(entry["rooms"]), None),
        (entry["verdict"], VERDICTS.index(entry["verdict"])),
        (entry["progress"], None),
        (entry["tolerance"], None),
        (signed_mm(offset), None if offset is None else abs(offset)),
        ("" if sigma is None else f"{1000 * sigma:.1f} mm", sigma),
        (entry["loa"], None),
        (entry["din_18202"], None),
        ("" if coverage is None else f"{100 * coverage:.0f} %", coverage),
        (entry["reason"], None),
    ]
    return [(text or NOTHING, sort) for text, sort in cells]


def shown_as_element(wall: Entry) -> dict[str, Any]:
    """An entry of `unplanned` in elements.json, in the form of an entry of `elements`, as far as the report shows it;
    the wall is drawn 0.1 m thick."""
    low, high = wall["height_m"]
    first, last = np.array(wall["trace"])
    behind = -0.1 * np.array(wall["facing"])
    return {
        "global_id": wall["id"],
        "name": f"{wall['length_m']:.1f} m, not planned",
        "ifc_class": "IfcWall",
        "storey": wall["storey"],
        "rooms": [wall["room"]] if wall["room"] else [],
        "verdict": UNPLANNED,
        "reason": f"{wall['length_m']:.1f} m long, z {low:.2f} to {high:.2f} m; {wall['reason']}",
        "outline": [place.tolist() for place in (first, last, last + behind, first + behind)],
        **dict.fromkeys(("offset_m", "sigma_m", "loa", "din_18202", "progress", "tolerance", "coverage", "doubt")),
    }
