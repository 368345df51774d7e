"""Tables over as many sheets as they need, each with the head of the table."""

from collections.abc import Sequence
from dataclasses import dataclass

from sgslam.report.pdf.sheet import BOTTOM, INK, MARGIN, MUTED, TOP, Sheet, wrapped

_SIZE, _LINE, _GAP, _PAD = 7.0, 9.1, 8.0, 3.4  # points: letters, line, between columns, above and below a row
_TITLE = 24.0  # points, of a table's title with what is below it


@dataclass(frozen=True)
class Column:
    """`width` in points; `numbers` are set to the right."""

    name: str
    width: float
    numbers: bool = False


@dataclass(frozen=True)
class Row:
    """As many `texts` as columns; `color` is that of the cell number `colored`."""

    texts: Sequence[str]
    color: str = INK
    colored: int = -1


def table_sheets(title: str, remark: str, columns: Sequence[Column], rows: Sequence[Row]) -> list[Sheet]:
    """Empty without rows; `remark` is said under the title of the first sheet."""
    sheets: list[Sheet] = []
    y = BOTTOM
    for row in rows:
        lines = [wrapped(text, c.width - _GAP, _SIZE) for c, text in zip(columns, row.texts, strict=True)]
        height = _LINE * max(map(len, lines)) + 2 * _PAD
        if y + height > BOTTOM:
            sheets.append(Sheet())
            y = _head(sheets[-1], title if len(sheets) == 1 else f"{title}, continued", remark, columns)
            remark = ""
        _draw(sheets[-1], y, columns, row, lines)
        y += height
    return sheets


def _head(sheet: Sheet, title: str, remark: str, columns: Sequence[Column]) -> float:
    """Draws the title and the columns' names; returns where the rows begin."""
    sheet.text(MARGIN, TOP, title, 12.0, weight="bold")
    y = TOP + _TITLE
    if remark:
        lines = wrapped(remark, sum(column.width for column in columns), 8.0)
        sheet.text(MARGIN, y - 4, "\n".join(lines), 8.0, MUTED)
        y += 10.5 * len(lines) + 4
    x = MARGIN
    for column in columns:
        _cell(sheet, x, y, column, [column.name], MUTED)
        x += column.width
    return y + _LINE + 2 * _PAD


def _draw(sheet: Sheet, y: float, columns: Sequence[Column], row: Row, lines: list[list[str]]) -> None:
    sheet.rule(y)
    x = MARGIN
    for k, (column, own) in enumerate(zip(columns, lines, strict=True)):
        _cell(sheet, x, y + _PAD, column, own, row.color if k == row.colored else INK)
        x += column.width


def _cell(sheet: Sheet, x: float, y: float, column: Column, lines: list[str], color: str) -> None:
    edge = x + column.width - _GAP if column.numbers else x
    sheet.text(edge, y, "\n".join(lines), _SIZE, color, ha="right" if column.numbers else "left")
