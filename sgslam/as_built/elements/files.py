"""Writes the verdicts of all elements, and the walls that no plan shows.

They are in elements.json, and as tables in elements.csv and, with openpyxl, elements.xlsx.
"""

import io
import logging
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from data.common.files import write_atomically, write_csv, write_json
from sgslam.as_built.deviation_bands import UNPLANNED

_log = logging.getLogger(__name__)
JSON, CSV, XLSX = "elements.json", "elements.csv", "elements.xlsx"
PICTURES = "heat_maps"  # a folder, of the export cloud-to-model
Cell = str | float | int | None
Entry = Mapping[str, Any]  # of elements.json
# of a planned element; the last one is added
_COLUMNS: dict[str, Callable[[Entry], Cell]] = {
    "name": lambda of: _text(of["name"]),
    "GlobalId": lambda of: _text(of["global_id"]),
    "class": lambda of: _text(of["ifc_class"]),
    "storey": lambda of: _text(of["storey"]),
    "room": lambda of: _text(", ".join(of["rooms"])),
    "grid": lambda of: _text(of.get("grid", "")),
    "verdict": lambda of: of["verdict"],
    "progress": lambda of: of["progress"],
    "tolerance": lambda of: of["tolerance"],
    "offset (m)": lambda of: _rounded(of["offset_m"], 4),
    "direction (x y z)": lambda of: _vector(of["direction"]),
    "sigma (m)": lambda of: _rounded(of["sigma_m"], 4),
    "LOA": lambda of: of["loa"],
    "conclusive": lambda of: "yes" if of["conclusive"] else "no",
    "turn (deg)": lambda of: _degrees(of["turn_rad"]),
    "turn sigma (deg)": lambda of: _degrees(of["turn_sigma_rad"]),
    "DIN 18202 limit (m)": lambda of: of["din_18202_limit_m"],
    "DIN 18202": lambda of: of["din_18202"],
    "coverage": lambda of: of["coverage"],
    "seen": lambda of: of["seen"],
    "views": lambda of: of["views"],
    "length (m)": lambda of: None,
    "ends x y (m)": lambda of: None,
    "z (m)": lambda of: None,
    "reason": lambda of: of["reason"],
}
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # begin a formula where a spreadsheet reads a text


def write_elements(out: Path, elements: Sequence[Entry], tolerance: float, unplanned: Sequence[Entry] = ()) -> None:
    """Writes the files to the folder `out`, each atomically; `tolerance` (m) is that of the verdicts."""
    counts = Counter(entry["verdict"] for entry in elements)
    content = {"tolerance_m": tolerance, "counts": counts, "elements": elements, "unplanned": unplanned}
    write_json(out / JSON, content)
    write_tables(out, elements, [wall for wall in unplanned if wall["kind"] == "wall-like"])


def write_tables(out: Path, entries: Sequence[Entry], unplanned: Sequence[Entry] = ()) -> None:
    """Writes the entries of elements.json as tables, with the pictures that are there; unplanned walls come last."""
    rows = [[*(cell(of) for cell in _COLUMNS.values()), _picture(out, of["global_id"])] for of in entries]
    rows += [_unplanned_row(entry) for entry in unplanned]
    write_csv(out / CSV, [[*_COLUMNS, "picture"], *rows])
    if find_spec("openpyxl") is None:
        (out / XLSX).unlink(missing_ok=True)  # that of an earlier run in this folder
        _log.info("%s is not written; it needs pip install 'sgslam[office]'", XLSX)
        return
    write_atomically(out / XLSX, _workbook(rows))


def remove_elements(out: Path) -> None:
    """Deletes the files that an earlier run left in the folder `out`."""
    for name in (JSON, CSV, XLSX):
        (out / name).unlink(missing_ok=True)


def _unplanned_row(of: Entry) -> list[Cell]:
    """All columns; those of what was planned are empty."""
    named: dict[str, Cell] = {
        "name": of["id"],
        "storey": _text(of["storey"]),
        "room": _text(of["room"]),
        "verdict": UNPLANNED,
        "length (m)": of["length_m"],
        "ends x y (m)": "; ".join(f"{x:.2f} {y:.2f}" for x, y in of["trace"]),
        "z (m)": " to ".join(f"{z:.2f}" for z in of["height_m"]),
        "reason": of["reason"],
    }
    return [named.get(column) for column in (*_COLUMNS, "picture")]


def picture_of(global_id: str) -> str:
    """The file of an element's heat map, within the run's folder; another model's ids may hold what no file may."""
    safe = re.sub(r"[^\w$-]", "_", global_id)
    return f"{PICTURES}/{safe}.png"


def _picture(out: Path, global_id: str) -> str:
    name = picture_of(global_id)
    return name if (out / name).is_file() else ""


def _degrees(radians: float | None) -> float | None:
    return None if radians is None else _rounded(math.degrees(radians), 3)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits) + 0.0  # no -0.0


def _vector(of: Sequence[float] | None) -> str | None:
    return None if of is None else " ".join(f"{_rounded(value, 3):.3f}" for value in of)


def _text(text: str) -> str:
    """Text of the model's author, which a spreadsheet must not take for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _workbook(rows: list[list[Cell]]) -> bytes:
    from openpyxl import Workbook
    from openpyxl.utils import get_column_letter

    book = Workbook()
    sheet = book.active
    sheet.title = "elements"
    for row in ([*_COLUMNS, "picture"], *rows):
        sheet.append(row)
    for picture in sheet[get_column_letter(len(_COLUMNS) + 1)][1:]:
        picture.hyperlink = picture.value or None
    sheet.freeze_panes = "A2"
    sheet.auto_filter.ref = sheet.dimensions
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()
