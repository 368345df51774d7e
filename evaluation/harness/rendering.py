"""Writes every number of the pages from the rows.

A page has blocks `<!-- rows: STUDY/NAME -->...<!-- /rows -->`. What is between the marks is written here: a table with
its source, or a short text within a sentence. An empty block stays so until its study has rows. `STUDY/commands` are
the commands of all rows. `STUDY/NAME@ROW,COLUMN` is a cell of a table, counted from 0.
"""

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness.row_file import read_rows, rows_path
from evaluation.harness.running import QUICK, ROWS
from evaluation.harness.study import STUDIES, load_study
from evaluation.harness.tables import frame, markdown

ROOT = Path(__file__).resolve().parents[2]
PLOTS = ROOT / "docs/benchmarks"
BLOCK = re.compile(r"(<!-- rows: ([a-z_]+)/([\w@,-]+) -->)(.*?)(<!-- /rows -->)", re.DOTALL)
CLAIMS, COMMANDS = "claims", "commands"
_HEAD = ("claim", "value", "cases", "study", "commit")


class Renderer:
    """Renders pages from the rows of a folder; with `mixed`, a table may have rows of several builds, and says so."""

    def __init__(self, rows: Path = ROWS, mixed: bool = False) -> None:
        self._rows, self._mixed = rows, mixed
        self._tables = cache(self._tables_of)
        self._frame = cache(self._read)

    def page(self, text: str) -> str:
        """The page with today's blocks. Raises UserError for a block that there is not, and for mixed builds."""

        def block(found: re.Match[str]) -> str:
            begin, study, name, content, end = found.groups()
            if not content and study in STUDIES and not self.has_rows(study):
                return found[0]  # its study is still to be run
            return begin + self._block(study, name) + end

        return BLOCK.sub(block, text)

    def rows_of(self, study: str) -> pd.DataFrame:
        """The rows of the study, or those of its short version. Raises UserError without any, and for mixed builds."""
        return self._frame(study)

    def tables(self, study: str) -> Mapping[str, Any]:
        """The tables and texts of a study, by name."""
        return self._tables(study)

    def claims(self) -> pd.DataFrame:
        """A line for each claim of a study that has rows."""
        lines: list[tuple[str, ...]] = []
        for name in filter(self.has_rows, STUDIES):
            rows = self.rows_of(name)
            made = rows.iloc[-1]
            source = (f"[{name}](docs/benchmarks/{name}.md)", f"`{made['made.commit']}`")
            lines += [(claim.text, claim.value, claim.cases, *source) for claim in load_study(name).claims(rows)]
        return pd.DataFrame(lines, columns=list(_HEAD))

    def _block(self, study: str, name: str) -> str:
        if study == CLAIMS:
            return f"\n{markdown(self.claims())}\n"
        if name == COMMANDS:
            return "\n" + "".join(f"- `{command}`\n" for command in self._made(study, "command"))
        content = self._content(study, name)
        if isinstance(content, str):
            return content
        return f"\n{markdown(content)}\n\n{self._source(study)}\n"

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

    def _tables_of(self, study: str) -> Mapping[str, Any]:
        return load_study(study).tables(self.rows_of(study))

    def has_rows(self, study: str) -> bool:
        """Whether the study, or its short version, has rows."""
        return any(read_rows(rows_path(folder, study)) for folder in (self._rows, self._rows / QUICK))

    def _read(self, study: str) -> pd.DataFrame:
        rows = read_rows(rows_path(self._rows, study)) or read_rows(rows_path(self._rows / QUICK, study))
        if not rows:
            raise UserError(f"{study}: no rows; make them with python -m evaluation run {study}")
        apart, builds = load_study(study).apart, dict[str, dict[str, None]]()
        for row in rows:
            builds.setdefault(str(row.case[apart]) if apart else "", {})[row.made.build] = None
        most = max(builds.values(), key=len)
        if len(most) > 1 and not self._mixed:
            text = f"{study}: its rows are of {len(most)} builds ({', '.join(most)})"
            raise UserError(f"{text}; run the study again, or allow it with --mixed")
        return frame(rows)

    def _made(self, study: str, name: str) -> list[str]:
        """The different values of a field of the rows' provenance."""
        return list(dict.fromkeys(self.rows_of(study)[f"made.{name}"]))

    def _source(self, study: str) -> str:
        """The source of a table in one line; the commands are on the study's page."""
        made = self._made(study, "commit")
        mixed = f"**Rows of {len(made)} commits:** " if len(made) > 1 else "Commit "
        commits = mixed + ", ".join(f"`{commit}`" for commit in made)
        last_day = max(self._made(study, "date")).partition(" ")[0]
        return f"{commits}, {len(self.rows_of(study))} rows, {last_day}, {'; '.join(self._made(study, 'machine'))}"


def pages() -> list[Path]:
    """The pages that may hold blocks."""
    return [ROOT / "README.md", ROOT / "BENCHMARKS.md", *sorted((ROOT / "docs").rglob("*.md"))]


def render(mixed: bool = False) -> list[Path]:
    """Writes all pages and plots from the rows; returns the pages that changed."""
    renderer = Renderer(mixed=mixed)
    texts = {path: path.read_text() for path in pages()}
    changed = {path: new for path, text in texts.items() if (new := renderer.page(text)) != text}
    for path, text in changed.items():
        write_atomically(path, text)
    for study in filter(renderer.has_rows, STUDIES):
        load_study(study).plots(renderer.rows_of(study), PLOTS)
    return list(changed)


def render_folder(rows: Path, mixed: bool = False) -> list[Path]:
    """Writes all tables and texts of the studies with rows in a folder of one's own there: `NAME.md`, the tables as
    `NAME.tex` (which needs the LaTeX package booktabs), and the plots. Returns the pages.

    Raises UserError if there are no rows.
    """
    renderer = Renderer(rows, mixed)
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
        load_study(name).plots(renderer.rows_of(name), rows)
    return [rows / f"{name}.md" for name in found]
