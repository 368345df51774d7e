"""Writes the verdicts of all elements, and the walls that no plan shows.

They are in elements.json, and as tables in elements.csv and, with openpyxl, elements.xlsx.
"""

import csv
import io
import logging
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from data.common.files import write_atomically, write_json
from sgslam.as_built.deviation_bands import UNPLANNED

_log = logging.getLogger(__name__)
JSON, CSV, XLSX = "elements.json", "elements.csv", "elements.xlsx"
PICTURES = "heat_maps"  # a folder, of the export cloud-to-model
COLUMNS = (
    "name", "GlobalId", "class", "storey", "room", "grid", "verdict", "offset (m)", "direction (x y z)", "sigma (m)",
    "LOA", "conclusive", "turn (deg)", "turn sigma (deg)", "DIN 18202 limit (m)", "DIN 18202", "seen", "views",
    "length (m)", "ends x y (m)", "z (m)", "reason", "picture",
)  # fmt: skip
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # begin a formula where a spreadsheet reads a text
Cell = str | float | int | None


def write_elements(
    out: Path, elements: Sequence[Mapping[str, Any]], tolerance: float, unplanned: Sequence[Mapping[str, Any]] = ()
) -> None:
    """Writes the files to the folder `out`, each atomically; `tolerance` (m) is that of the verdicts."""
    counts = Counter(entry["verdict"] for entry in elements)
    content = {"tolerance_m": tolerance, "counts": counts, "elements": elements, "unplanned": unplanned}
    write_json(out / JSON, content)
    write_tables(out, elements, [wall for wall in unplanned if wall["kind"] == "wall-like"])


def write_tables(out: Path, entries: Sequence[Mapping[str, Any]], unplanned: Sequence[Mapping[str, Any]] = ()) -> None:
    """Writes the entries of elements.json as tables, with the pictures that are there; unplanned walls come last."""
    rows = [[*_row(entry), _picture(out, entry["global_id"])] for entry in entries]
    rows += [_unplanned_row(entry) for entry in unplanned]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / CSV, text.getvalue())
    if find_spec("openpyxl") is None:
        (out / XLSX).unlink(missing_ok=True)  # that of an earlier run in this folder
        _log.info("%s is not written; it needs pip install 'sgslam[office]'", XLSX)
        return
    write_atomically(out / XLSX, _workbook(rows))


def remove_elements(out: Path) -> None:
    """Deletes the files that an earlier run left in the folder `out`."""
    for name in (JSON, CSV, XLSX):
        (out / name).unlink(missing_ok=True)


def _row(of: Mapping[str, Any]) -> list[Cell]:
    """All columns but the picture."""
    named = [of[name] for name in ("name", "global_id", "ifc_class", "storey")]
    texts = [_text(text) for text in (*named, ", ".join(of["rooms"]), of.get("grid", ""))]
    return [
        *texts, of["verdict"], _rounded(of["offset_m"], 4), _vector(of["direction"]), _rounded(of["sigma_m"], 4),
        of["loa"], "yes" if of["conclusive"] else "no", _degrees(of["turn_rad"]), _degrees(of["turn_sigma_rad"]),
        of["din_18202_limit_m"], of["din_18202"], of["seen"], of["views"], None, None, None, of["reason"],
    ]  # fmt: skip


def _unplanned_row(of: Mapping[str, Any]) -> list[Cell]:
    """All columns; those of what was planned are empty."""
    named: dict[str, Cell] = {
        "name": of["id"], "storey": _text(of["storey"]), "room": _text(of["room"]), "verdict": UNPLANNED,
        "length (m)": of["length_m"], "ends x y (m)": "; ".join(f"{x:.2f} {y:.2f}" for x, y in of["trace"]),
        "z (m)": " to ".join(f"{z:.2f}" for z in of["height_m"]), "reason": of["reason"],
    }  # fmt: skip
    return [named.get(column) for column in COLUMNS]


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
    for row in (COLUMNS, *rows):
        sheet.append(row)
    for picture in sheet[get_column_letter(len(COLUMNS))][1:]:
        picture.hyperlink = picture.value or None
    sheet.freeze_panes = "A2"
    sheet.auto_filter.ref = sheet.dimensions
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()
