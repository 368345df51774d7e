"""The first sheet: what was compared, the verdicts in numbers, and what its words mean."""

from collections.abc import Sequence

from sgslam.report import tables
from sgslam.report.contents import ReportData
from sgslam.report.elements import coverage, planned_count, verdict_counts
from sgslam.report.pdf.sheet import INK, MARGIN, MUTED, RIGHT, TOP, VERDICT_COLORS, Sheet, wrapped

_TILE, _BETWEEN = 64.0, 12.0  # points, height of a count's box, and between boxes
_LINE = 13.0  # points
_MOST_LINES = 3  # of a value; names of folders may be longer
_FRAME = "T_bim_map"  # in the summary, numbers for programs
WORDS = (
    ("as planned", "its surface is within the tolerance of its planned place"),
    ("moved", "it is farther off, by more than two standard deviations of the measurement"),
    ("absent", "the scans see through its place"),
    ("unplanned", "a wall stands where the plan has none"),
    ("uncertain", "something stands there, but it is not certain that it is the element"),
    ("not seen", "too little of it was in view to decide whether it stands"),
    ("not conclusive", "the offset differs from the tolerance by less than two standard deviations"),
    ("LOA", "level of accuracy of the measurement (USIBD, at 95 %): LOA40 5 mm, LOA30 15 mm, LOA20 50 mm"),
    ("DIN 18202", "whether a wall's direction in plan view is within the limit for its length (table 2)"),
)


def cover(data: ReportData) -> Sheet:
    """The sheet of a run, anchored or not."""
    sheet = Sheet()
    sheet.text(MARGIN, TOP, "As built against as planned", 20.0, weight="bold")
    badge = tables.badge(data.metrics | {"anchored": data.T_bim_map is not None})
    reason = wrapped(f"{badge.capitalize()}: {data.metrics.get('reason') or ''}", RIGHT - MARGIN, 9.5)[:3]
    sheet.text(MARGIN, TOP + 30, "\n".join(reason), 9.5, MUTED)
    y = TOP + 42 + _LINE * len(reason)
    if data.elements:
        _counts(sheet, y, data)
        y += _TILE + 24
    middle = (MARGIN + RIGHT) / 2
    about = [*(data.metrics.get("about") or {}).items()]
    about += [(name, value) for name, value in tables.summary_rows(data) if not name.startswith(_FRAME)]
    _pairs(sheet, MARGIN, y, middle - 20, about, 130.0)
    y = _pairs(sheet, middle, y, RIGHT, _quality(data), 200.0)
    if data.elements:
        _pairs(sheet, middle, y + 14, RIGHT, WORDS, 80.0)
    return sheet


def _counts(sheet: Sheet, y: float, data: ReportData) -> None:
    counts = [(f"{100 * coverage(data.elements):.0f} %", f"of {planned_count(data.elements)} elements seen", INK)]
    counts += [(str(n), name, VERDICT_COLORS[name]) for name, n in verdict_counts(data.elements).items()]
    width = (RIGHT - MARGIN + _BETWEEN) / len(counts) - _BETWEEN
    for k, (number, name, color) in enumerate(counts):
        x = MARGIN + k * (width + _BETWEEN)
        sheet.box(x, y, width, 3.0, color)
        sheet.text(x, y + 12, number, 20.0, color, weight="bold")
        sheet.text(x, y + 40, name, 9.0, MUTED)


def _quality(data: ReportData) -> list[tuple[str, str]]:
    return [(phrase, f"{value}, {limit}: {state}") for phrase, value, limit, state in tables.quality_rows(data.metrics)]


def _pairs(
    sheet: Sheet, x: float, y: float, right: float, rows: Sequence[tuple[str, str]], indent: float
) -> float:  # fmt: skip
    """Names with their values beside them; returns where they end."""
    for name, value in rows:
        names, values = (
            wrapped(text, width, 8.0)[:_MOST_LINES] for text, width in ((name, indent - 8), (value, right - x - indent))
        )
        sheet.text(x, y, "\n".join(names), 8.0, MUTED)
        sheet.text(x + indent, y, "\n".join(values), 8.0)
        y += _LINE + 10.0 * (max(len(names), len(values)) - 1)
    return y
