"""Writes the verdicts of all elements: elements.json, and as tables elements.csv and, with openpyxl, elements.xlsx."""

import csv
import io
import logging
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

from data.common.files import write_atomically, write_json
from sgslam.as_built.elements import ElementVerdict

_log = logging.getLogger(__name__)
JSON, CSV, XLSX = "elements.json", "elements.csv", "elements.xlsx"
COLUMNS = (
    "name", "GlobalId", "class", "storey", "room", "verdict", "offset (m)", "sigma (m)", "LOA", "conclusive",
    "turn (deg)", "turn sigma (deg)", "DIN 18202 limit (m)", "DIN 18202", "seen", "views", "reason",
)  # fmt: skip
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # begin a formula where a spreadsheet reads a text
Cell = str | float | int | None


def write_elements(out: Path, verdicts: Sequence[ElementVerdict], tolerance: float) -> None:
    """Writes the files to the folder `out`, each atomically; `tolerance` (m) is that of the verdicts."""
    counts = Counter(verdict.verdict for verdict in verdicts)
    entries = [asdict(verdict) for verdict in verdicts]
    write_json(out / JSON, {"tolerance_m": tolerance, "counts": dict(counts), "elements": entries})
    rows = [_row(verdict) for verdict in verdicts]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / CSV, text.getvalue())
    if find_spec("openpyxl") is None:
        (out / XLSX).unlink(missing_ok=True)  # that of an earlier run in this folder
        _log.info("%s is not written; pip install 'sgslam[office]' to have it", XLSX)
        return
    write_atomically(out / XLSX, _workbook(rows))


def remove_elements(out: Path) -> None:
    """Deletes the files that an earlier run left in the folder `out`."""
    for name in (JSON, CSV, XLSX):
        (out / name).unlink(missing_ok=True)


def _row(v: ElementVerdict) -> list[Cell]:
    texts = [_text(text) for text in (v.name, v.global_id, v.ifc_class, v.storey, ", ".join(v.rooms))]
    sure = "yes" if v.conclusive else "no"
    return [
        *texts, v.verdict, _rounded(v.offset_m, 4), _rounded(v.sigma_m, 4), v.loa, sure, _degrees(v.turn_rad),
        _degrees(v.turn_sigma_rad), v.din_18202_limit_m, v.din_18202, v.seen, v.views, v.reason,
    ]  # fmt: skip


def _degrees(radians: float | None) -> float | None:
    return None if radians is None else round(math.degrees(radians), 3)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _text(text: str) -> str:
    """Text of the model's author, which a spreadsheet must not take for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _workbook(rows: list[list[Cell]]) -> bytes:
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.title = "elements"
    for row in (COLUMNS, *rows):
        sheet.append(row)
    sheet.freeze_panes = "A2"
    sheet.auto_filter.ref = sheet.dimensions
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()
