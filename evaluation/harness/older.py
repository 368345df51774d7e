"""Tables of older builds, whose rows were not kept; they go when their study is measured again."""

import json
from pathlib import Path

from evaluation.harness.row_file import rows_path


def older_tables(rows: Path, study: str) -> dict[str, str]:
    """The tables of a study in Markdown by their names, each with its title, note and source."""
    path = rows_path(rows / "older", study)
    lines = path.read_text().splitlines() if path.exists() else []
    return {value["table"]: _markdown(value) for value in map(json.loads, lines)}


def _markdown(value: dict[str, object]) -> str:
    header, rows, made = value["header"], value["rows"], value["made"]
    assert isinstance(header, list) and isinstance(rows, list) and isinstance(made, dict)
    table = "\n".join("| " + " | ".join(line) + " |" for line in (header, ["---"] * len(header), *rows))
    source = f"Commit `{made['commit']}`, {made['date']}, {made['machine']}, by what was then `{made['command']}`"
    note = f" {value['note']}" if value["note"] else ""
    return f"**{value['title']}.**{note}\n\n{table}\n\n{source}"
