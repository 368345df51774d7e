"""Writes every number of the pages from the rows.

A page has blocks `<!-- rows: STUDY/NAME -->...<!-- /rows -->`. What is between the marks is written here: a table with
its source, or a short text within a sentence. An empty block stays so until its study has rows. `STUDY/commands` are
the commands of all rows, and the machine. `STUDY/NAME@ROW,COLUMN` is a cell of a table, counted from 0;
`claims/claims` are the claims of all studies.
"""

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.rows import ROOT, read_rows, rows_path
from evaluation.study import STUDIES, load_study
from evaluation.tables import frame, markdown

PAGES = ROOT / "docs/benchmarks"
ROWS = PAGES / "rows" if PAGES.is_dir() else Path("out/evaluation/rows")  # beside the pages in a checkout
QUICK = "quick"  # folder of the rows of the short versions
BLOCK = re.compile(r"(<!-- rows: ([a-z_]+)/([\w@,-]+) -->)(.*?)(<!-- /rows -->)", re.DOTALL)
CLAIMS, COMMANDS = "claims", "commands"


class Renderer:
    """Renders pages from the rows of a folder."""

    def __init__(self, rows: Path = ROWS) -> None:
        self._folder = rows
        self.rows_of = cache(self._read)
        self.tables = cache(self._tables_of)

    def page(self, text: str) -> str:
        """The page with today's blocks. Raises UserError for a block that there is not."""

        def block(found: re.Match[str]) -> str:
            begin, study, name, content, end = found.groups()
            if not content and study in STUDIES and not self.has_rows(study):
                return found[0]  # its study is still to be run
            return begin + self._block(study, name) + end

        return BLOCK.sub(block, text)

    def has_rows(self, study: str) -> bool:
        """Whether the study, or its short version, has rows."""
        return bool(self._rows(study))

    def claims(self) -> pd.DataFrame:
        """A line for each claim of a study that has rows."""
        lines = []
        for name in filter(self.has_rows, STUDIES):
            rows = self.rows_of(name)
            commit = f"`{rows.iloc[-1]['made.commit']}`"
            lines += [(c.text, c.value, c.units, f"[{name}]({name}.md)", commit) for c in load_study(name).claims(rows)]
        return pd.DataFrame(lines, columns=["claim", "value", "units", "study", "commit"])

    def _block(self, study: str, name: str) -> str:
        if study == CLAIMS:
            return f"\n{markdown(self.claims())}\n"
        if name == COMMANDS:
            rows = self.rows_of(study)
            commands = "".join(f"- `{command}`\n" for command in dict.fromkeys(rows["made.command"]))
            return f"\n{commands}\nOn {'; '.join(dict.fromkeys(rows['made.machine']))}.\n"
        content = self._content(study, name)
        return content if isinstance(content, str) else f"\n{markdown(content)}\n\n{self._source(study)}\n"

    def _content(self, study: str, name: str) -> Any:
        """A table or a text. Raises UserError if the study has none of this name."""
        name, _, cell = name.partition("@")
        tables = self.tables(study)
        if name not in tables:
            raise UserError(f"<!-- rows: {study}/{name} -->: {study} has no such table; it has {', '.join(tables)}")
        if not cell:
            return tables[name]
        row, column = map(int, cell.split(","))
        try:
            return str(tables[name].iloc[row, column])
        except IndexError:
            raise UserError(f"<!-- rows: {study}/{name}@{cell} -->: the table has {tables[name].shape} cells") from None

    def _rows(self, study: str) -> Any:
        return read_rows(rows_path(self._folder, study)) or read_rows(rows_path(self._folder / QUICK, study))

    def _read(self, study: str) -> pd.DataFrame:
        """The rows of the study, or those of its short version. Raises UserError without any."""
        rows = frame(self._rows(study))
        if not len(rows):
            raise UserError(f"{study}: no rows; make them with python -m evaluation run {study}")
        return rows

    def _tables_of(self, study: str) -> Mapping[str, Any]:
        return load_study(study).tables(self.rows_of(study))

    def _source(self, study: str) -> str:
        """The source of a table in one line; the commands are on the study's page."""
        rows = self.rows_of(study)
        commits = ", ".join(f"`{commit}`" for commit in dict.fromkeys(rows["made.commit"]))
        failed = sum(row.failed for row in self._rows(study))
        counted = f"{len(rows)} rows" + (f", {failed} more failed" if failed else "")
        return f"Commit {commits}, {counted}, {max(rows['made.date']).partition(' ')[0]}"


def pages() -> list[Path]:
    """The pages that may hold blocks."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def render() -> list[Path]:
    """Writes all pages from the rows; returns the pages that changed."""
    renderer = Renderer()
    texts = {path: path.read_text() for path in pages()}
    changed = {path: new for path, text in texts.items() if (new := renderer.page(text)) != text}
    for path, text in changed.items():
        write_atomically(path, text)
    return list(changed)


def render_folder(rows: Path) -> list[Path]:
    """Writes all tables and texts of the studies with rows in a folder of one's own there: `NAME.md`, the tables as
    `NAME.tex` (which needs the LaTeX package booktabs). Returns the pages.

    Raises UserError if there are no rows.
    """
    renderer = Renderer(rows)
    names = sorted({path.name.partition(".")[0] for path in rows.glob("*.jsonl*")})
    found = [name for name in names if renderer.has_rows(name)]
    if not found:
        raise UserError(f"{rows}: no rows of a study")
    for name in found:
        tables = renderer.tables(name)
        blocks = "\n".join(f"## {table}\n<!-- rows: {name}/{table} --><!-- /rows -->\n" for table in tables)
        blocks += f"\n## Commands\n<!-- rows: {name}/{COMMANDS} --><!-- /rows -->\n"
        write_atomically(rows / f"{name}.md", renderer.page(f"# {name}\n\n{blocks}"))
        latex = [table.to_latex(index=False, escape=True) for table in tables.values() if not isinstance(table, str)]
        write_atomically(rows / f"{name}.tex", "\n".join(latex))
    return [rows / f"{name}.md" for name in found]
