"""The sheets of a report in their order, with head and page number, and the file."""

import io
import warnings
from collections.abc import Sequence
from pathlib import Path

from data.common.files import write_atomically
from sgslam.report import tables
from sgslam.report.contents import ReportData
from sgslam.report.elements import COLUMNS, ElementRow, element_rows
from sgslam.report.number_formats import thousands
from sgslam.report.pdf.cover import cover
from sgslam.report.pdf.plans import plan_sheets
from sgslam.report.pdf.sheet import HEIGHT, MARGIN, MUTED, RIGHT, VERDICT_COLORS, Sheet, text_width
from sgslam.report.pdf.tables import Column, Row, table_sheets

FILE = "report.pdf"
MOST_ROWS = 600  # elements in the table, some 25 sheets
_ELEMENTS = (
    Column("No.", 26, True), Column(COLUMNS[0], 118), Column(COLUMNS[1], 52), Column(COLUMNS[2], 62),
    Column(COLUMNS[3], 116), Column(COLUMNS[4], 66), Column(COLUMNS[5], 56, True), Column(COLUMNS[6], 46, True),
    Column(COLUMNS[7], 38), Column(COLUMNS[8], 52), Column(COLUMNS[9], 36, True), Column(COLUMNS[10], 90),
)  # fmt: skip
_DEVIATIONS = (
    Column("Wall", 180), Column("Room", 160), Column("Offset", 70, True), Column("Sigma", 60, True),
    Column("Tilt", 60, True), Column("Reason", 228),
)  # fmt: skip


def write_pdf(data: ReportData, path: Path | str) -> int:
    """Writes the report atomically; returns the number of its sheets."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    made, file = sheets(data), io.BytesIO()
    told = {"Title": "As built against as planned", "Creator": "sgslam", "CreationDate": None}
    with mpl.rc_context({"pdf.fonttype": 42}), PdfPages(file, metadata=told) as pages, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # letters that the font lacks are boxes
        for sheet in made:
            pages.savefig(sheet.figure)
    write_atomically(path, file.getvalue())
    return len(made)


def sheets(data: ReportData) -> list[Sheet]:
    """Cover, plans, elements that were seen, and deviations of walls, each sheet with head and page number."""
    rows = element_rows(data.elements)
    numbers = {row.global_id: number for number, row in enumerate(rows, 1)}
    made = [cover(data), *plan_sheets(data, numbers), *_elements(rows), *_deviations(data)]
    about = data.metrics.get("about") or {}
    for number, sheet in enumerate(made, 1):
        _head(sheet, about, f"page {number} of {len(made)}")
    return made


def _elements(rows: Sequence[ElementRow]) -> list[Sheet]:
    seen = [row for row in rows if row.verdict != "not seen"]
    remark = f"{thousands(len(rows) - len(seen))} elements that were not seen are not listed; elements.csv has all."
    if len(seen) > MOST_ROWS:
        remark += f" The first {MOST_ROWS} of {thousands(len(seen))} are shown."
    lines = [
        Row([str(number), *(cell.text for cell in row.cells)], VERDICT_COLORS[row.verdict], 5)
        for number, row in enumerate(seen[:MOST_ROWS], 1)
    ]
    return table_sheets("Planned elements", remark, _ELEMENTS, lines)


def _deviations(data: ReportData) -> list[Sheet]:
    """Of wall surfaces: the significant ones among the largest, those that no plan shows among them."""
    rows, looks = tables.deviation_rows(data)
    marked = [Row([*row[:5], row[6]]) for row, look in zip(rows, looks, strict=True) if "class" in look]
    remark = "Offsets are along the plan's inward normal: above 0, the wall stands further into the room."
    return table_sheets("Wall surfaces that deviate significantly", remark, _DEVIATIONS, marked)


def _head(sheet: Sheet, about: dict[str, str], page: str) -> None:
    """The building and the date above, the version and the page below."""
    name, room = about.get("Building", ""), RIGHT - MARGIN - 220
    while text_width(name, 9.0) > room:
        name = f"{name[:-2]}\N{HORIZONTAL ELLIPSIS}"
    sheet.text(MARGIN, 36, name, 9.0, weight="bold")
    sheet.text(RIGHT, 36, about.get("Measured", ""), 9.0, MUTED, ha="right")
    sheet.rule(52)
    sheet.text(MARGIN, HEIGHT - 32, about.get("Version", "sgslam"), 8.0, MUTED)
    sheet.text(RIGHT, HEIGHT - 32, page, 8.0, MUTED, ha="right")
