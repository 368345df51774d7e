"""A sheet of paper: text, lines and boxes at places in points from its upper left corner."""

from functools import cache
from typing import Any

WIDTH, HEIGHT, MARGIN = 841.89, 595.28, 42.0  # points, A4 across
TOP, BOTTOM = 74.0, HEIGHT - 44.0  # between them, in points from the upper edge, is what a sheet says
RIGHT = WIDTH - MARGIN
INK, MUTED, RULE = "#1b1f24", "#646c77", "#d5d9de"
VERDICT_COLORS = {
    "moved": "#c2410c", "absent": "#1d6fb8", "unplanned": "#a03a78", "uncertain": "#8a6d00", "as planned": "#0f7a6d",
    "not seen": "#727a85",
}  # fmt: skip
_FONT = "DejaVu Sans"  # comes with matplotlib
_POINTS = 72.0  # in an inch
_ASCENT, _LINE_HEIGHT = 0.93, 1.3  # of the font, relative to its size; from one line to the next


class Sheet:
    """One sheet; `figure` is what is written."""

    def __init__(self) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(WIDTH / _POINTS, HEIGHT / _POINTS))
        FigureCanvasAgg(self.figure)

    def text(self, x: float, y: float, text: str, size: float = 9.0, color: str = INK, **style: Any) -> None:
        """A text whose first line's upper left corner is at x, y; its upper right with `ha="right"`."""
        for number, line in enumerate(text.split("\n")):
            self._line(x, y + number * _LINE_HEIGHT * size, line, size, color, **style)

    def _line(self, x: float, y: float, text: str, size: float, color: str, **style: Any) -> None:
        look: dict[str, Any] = {"fontsize": size, "color": color, "fontfamily": _FONT, "parse_math": False}
        self.figure.text(x / WIDTH, 1 - (y + _ASCENT * size) / HEIGHT, text, va="baseline", **(look | style))

    def rule(self, y: float, color: str = RULE) -> None:
        """A line across the sheet."""
        self.box(MARGIN, y, RIGHT - MARGIN, 0.6, color)

    def box(self, x: float, y: float, width: float, height: float, color: str) -> None:
        """A filled rectangle whose upper left corner is at x, y."""
        from matplotlib.patches import Rectangle

        place = (x / WIDTH, 1 - (y + height) / HEIGHT)
        self.figure.add_artist(Rectangle(place, width / WIDTH, height / HEIGHT, fc=color, ec="none"))

    def axes(self, top: float, bottom: float) -> Any:
        """Axes over the sheet's whole width."""
        left, width = MARGIN / WIDTH, (RIGHT - MARGIN) / WIDTH
        return self.figure.add_axes((left, 1 - bottom / HEIGHT, width, (bottom - top) / HEIGHT))


def text_width(text: str, size: float) -> float:
    """Points that a text takes."""
    return size * sum(map(_advance, text))


def wrapped(text: str, width: float, size: float) -> list[str]:
    """The lines of a text that is `width` points wide; words that are wider are broken."""
    lines = [""]
    for word in text.split():
        joined = f"{lines[-1]} {word}".strip()
        if text_width(joined, size) <= width:
            lines[-1] = joined
            continue
        lines += [""] if lines[-1] else []
        for letter in word:
            if lines[-1] and text_width(lines[-1] + letter, size) > width:
                lines.append("")
            lines[-1] += letter
    return lines


@cache
def _advance(letter: str) -> float:
    """The width of a letter with the space beside it, relative to the text's size."""
    return _drawn_width(f"|{letter}|") - _drawn_width("||")


def _drawn_width(text: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family=_FONT, size=1.0)
    return float(text_to_path.get_text_width_height_descent(text, font, ismath=False)[0])
