"""`python -m sgslam.as_built.compare OUT1 OUT2`: what changed between two runs in one building, element by element.

It reads elements.json of both, prints the elements that changed, and writes compare.json and compare.csv to OUT2.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_csv, write_json
from sgslam.as_built.elements import SURE_SIGMAS
from sgslam.as_built.elements.files import JSON

COMPARE_JSON, COMPARE_CSV = "compare.json", "compare.csv"
Entry = dict[str, Any]
_COLUMNS = ("change", "name", "global_id", "ifc_class", "storey", "before", "after", "offset_m")
_STANDS = ("as planned", "moved")


def compare(before: Path, after: Path) -> list[Entry]:
    """The elements that were `built since`, `gone since`, `moved since` or are `still absent`, in the plan's order.

    Raises UserError for a run without elements.json and for runs of different plans.
    """
    first, second = _elements(before), _elements(after)
    if first.keys() != second.keys():
        raise UserError(f"{before} and {after}: their elements differ; give two runs with the same --bim")
    changes = ((_change(first[key], entry), first[key], entry) for key, entry in second.items())
    return [
        {
            "change": change,
            **{name: new[name] for name in _COLUMNS[1:5]},
            "before": old["verdict"],
            "after": new["verdict"],
            "offset_m": new["offset_m"],
        }
        for change, old, new in changes
        if change is not None
    ]


def _change(old: Entry, new: Entry) -> str | None:
    """None where nothing changed, or where one of the runs does not say."""
    if old["verdict"] == "absent":
        return "still absent" if new["verdict"] == "absent" else "built since" if new["verdict"] in _STANDS else None
    if old["verdict"] in _STANDS and new["verdict"] == "absent":
        return "gone since"
    between = _moved_by(old, new)
    if between is None:
        return None
    sigma = (old["sigma_m"] ** 2 + new["sigma_m"] ** 2) ** 0.5
    moved = between > SURE_SIGMAS * sigma
    return "moved since" if moved and old["verdict"] != new["verdict"] and new["verdict"] in _STANDS else None


def _moved_by(old: Entry, new: Entry) -> float | None:
    """Metres from the old place to the new, None where both were not measured along the same direction.

    A column's direction is that of its shift, so its shifts are compared as vectors.
    """
    if old["offset_m"] is None or new["offset_m"] is None:
        return None
    if old["direction"] != new["direction"] and not new["ifc_class"].startswith("IfcColumn"):
        return None
    shifts = ([entry["offset_m"] * axis for axis in entry["direction"]] for entry in (old, new))
    return math.dist(*shifts)


def _elements(out: Path) -> dict[str, Entry]:
    path = out / JSON
    if not path.is_file():
        raise UserError(f"{out}: has no {JSON}; give the --out of a run that was anchored to an IFC model")
    try:
        return {entry["global_id"]: entry for entry in json.loads(path.read_text())["elements"]}
    except (ValueError, KeyError, TypeError):
        raise UserError(f"{path}: is damaged; run it again") from None


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    from rich.console import Console
    from rich.table import Table

    about = "List what was built, removed or moved between two runs in a building."
    parser = Parser(prog="python -m sgslam.as_built.compare", description=about)
    parser.add_argument("before", type=Path, metavar="OUT1", help="--out folder of the earlier run")
    parser.add_argument("after", type=Path, metavar="OUT2", help="that of the later run; the files are written into it")
    options: argparse.Namespace = parser.parse_args(arguments)
    rows = compare(options.before, options.after)
    write_json(options.after / COMPARE_JSON, rows)
    write_csv(options.after / COMPARE_CSV, [_COLUMNS, *(row.values() for row in rows)])
    shown = Table("change", "name", "class", "storey", "before", "after")
    for row in rows:
        shown.add_row(*(str(row[name]) for name in ("change", "name", "ifc_class", "storey", "before", "after")))
    Console().print(shown if rows else "no changes in what both runs saw")
    return 0


if __name__ == "__main__":
    run_command(main)
