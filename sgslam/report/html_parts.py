"""The pieces that the page is built of: cards and tables, all text escaped."""

from collections.abc import Iterable, Sequence
from html import escape

NOTHING = "\N{EN DASH}"


def card(heading: str, content: str, note: str = "") -> str:
    """A titled box; `content` is HTML, the rest text."""
    below = f'<p class="muted">{escape(note)}</p>' if note else ""
    return f'<section class="card"><h2>{escape(heading)}</h2>{content}{below}</section>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers_from: int = -1, looks: Sequence[str] = ()) -> str:
    """First cells are row headings where the table has none of its own; columns from `numbers_from` on stand right.

    `looks` are attributes of the rows, already HTML. The table scrolls within its card.
    """
    top = "".join(f"<th{_right(i, len(head), numbers_from)}>{escape(cell)}</th>" for i, cell in enumerate(head))
    body = "".join(
        f"<tr{looks[i] if i < len(looks) else ''}>{_cells(row, numbers_from, not head)}</tr>"
        for i, row in enumerate(rows)
    )
    heading = f"<thead><tr>{top}</tr></thead>" if head else ""
    return f'<div class="scroll"><table>{heading}<tbody>{body}</tbody></table></div>'


def _cells(row: Sequence[str], numbers_from: int, headed: bool) -> str:
    tags = ["th" if headed and i == 0 else "td" for i in range(len(row))]
    return "".join(
        f"<{tag}{_right(i, len(row), numbers_from)}>{escape(cell)}</{tag}>"
        for i, (tag, cell) in enumerate(zip(tags, row, strict=True))
    )


def _right(index: int, count: int, numbers_from: int) -> str:
    return ' class="number"' if index >= numbers_from % count else ""


def count(value: int | None) -> str:
    """With thousands apart."""
    return NOTHING if value is None else f"{value:,}"


def metres(value: float | None) -> str:
    """A length as one reads it: in cm below 1 m."""
    if value is None:
        return NOTHING
    return f"{value * 100:.1f} cm" if abs(value) < 1 else f"{value:.2f} m"


def seconds(value: float | None) -> str:
    """A time as one reads it: in ms below 1 s."""
    return NOTHING if value is None else f"{value:.1f} s" if abs(value) >= 1 else f"{value * 1000:.0f} ms"
