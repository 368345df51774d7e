"""The rows of the table of elements, and the counts of the verdicts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sgslam.as_built.deviation_bands import UNPLANNED, signed_mm
from sgslam.report.elements.labels import VERDICTS, element_name, kind
from sgslam.report.number_formats import NOTHING

COLUMNS = (
    "Element", "Kind", "Storey", "Rooms", "Verdict", "Offset", "Sigma", "LOA", "DIN 18202", "Seen", "Reason"
)  # fmt: skip
Entry = Mapping[str, Any]  # of elements.json


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
