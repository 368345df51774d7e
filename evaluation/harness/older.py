"""Tables of older builds, whose rows were not kept; they go when their study is measured again."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from evaluation.harness.row_file import rows_path


class OlderClaim(BaseModel):
    """A claim whose value is a cell of the table, by the numbers of its row and column."""

    text: str
    row: int
    column: int
    cases: str


class Short(BaseModel):
    """A shorter version of a table: the numbers of its rows, and its columns' headings by their numbers."""

    rows: tuple[int, ...]
    columns: dict[int, str]


class Source(BaseModel):
    """Where a table comes from; the command is that of its time."""

    commit: str
    command: str
    machine: str
    date: str


class OlderTable(BaseModel):
    """A table as it was written: its cells are text."""

    model_config = ConfigDict(frozen=True)

    table: str
    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    made: Source
    claims: tuple[OlderClaim, ...] = ()
    short: Short | None = None

    def shortened(self) -> "OlderTable":
        """The shorter version, without the note and the command."""
        assert self.short is not None
        columns = self.short.columns
        lines = [[self.rows[row][column] for column in columns] for row in self.short.rows]
        made = self.made.model_copy(update={"command": ""})
        parts = {"header": [*columns.values()], "rows": lines, "note": "", "claims": (), "made": made}
        return self.model_copy(update=parts)

    def markdown(self) -> str:
        """The table in Markdown, with its title, note and source."""
        lines = (self.header, ["---"] * len(self.header), *self.rows)
        table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        made = self.made
        source = ", ".join(filter(None, (f"Older build: commit `{made.commit}`", made.date, made.machine)))
        source += f", by what was then `{made.command}`" if made.command else ""
        return f"**{self.title}.**{' ' * bool(self.note)}{self.note}\n\n{table}\n\n{source}"


def older_tables(rows: Path, study: str) -> dict[str, OlderTable]:
    """The older tables of a study, as `older-NAME`; a shorter version is `older-NAME-short`."""
    path = rows_path(rows / "older", study)
    lines = path.read_text().splitlines() if path.exists() else []
    whole = {f"older-{table.table}": table for table in map(OlderTable.model_validate_json, lines)}
    return whole | {f"{name}-short": table.shortened() for name, table in whole.items() if table.short}
