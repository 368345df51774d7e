"""The plan from above as inline SVG: layers that can be switched, text that zooms, strokes that do not."""

from html import escape

import numpy as np
from numpy.typing import NDArray

from sgslam.plan_drawing import DrawnRoom, DrawnWall, PlanDrawing

Array = NDArray[np.float64]
MARGIN = 0.03  # of the longer side


class _Pen:
    """Turns metres (y up) into the drawing's numbers: about its centre, y down, to the millimetre.

    Browsers draw in 32 bit floats, and a site may lie hundreds of kilometres from its model's origin.
    """

    def __init__(self, centre: Array) -> None:
        self.centre = centre

    def points(self, xy: Array) -> str:
        local = (xy.reshape(-1, 2) - self.centre) * [1, -1] + 0.0  # + 0.0: no minus zero
        return " ".join(f"{x:.3f},{y:.3f}" for x, y in local)

    def line(self, ends: Array, title: str = "") -> str:
        return f'<polyline points="{self.points(ends)}">{_title(title)}</polyline>'

    def polygon(self, outline: Array, title: str = "") -> str:
        return f'<polygon points="{self.points(outline)}">{_title(title)}</polygon>'

    def text(self, room: DrawnRoom, rise: float) -> str:
        x, y = self.points(room.label).split(",")
        place = f'x="{x}" y="{y}" dy="{rise}em" font-size="{room.text_size():.2f}"'
        return f"<text {place}>{escape(room.name)}</text>"


def plan_svg(drawing: PlanDrawing) -> str:
    """The SVG element `#plan`; layers that hold something are groups `layer-NAME` (see `drawing.labels`)."""
    low, high = drawing.bounds()
    pen = _Pen(np.round((low + high) / 2))
    margin = max(1.0, MARGIN * float((high - low).max()))
    width, height = high - low + 2 * margin
    left = (low - pen.centre)[0] - margin
    top = -(high - pen.centre)[1] - margin
    groups = _layers(drawing, pen)
    body = "\n".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups if content)
    scale = _scale_bar(float(left + 0.4 * margin), float(top + height - 0.4 * margin), float(width))
    return (
        f'<svg id="plan" viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}" '
        f'style="aspect-ratio: {width:.1f} / {height:.1f}" role="img" '
        f'aria-label="{escape(drawing.heading)}">\n{body}\n{scale}\n</svg>'
    )


def legend(drawing: PlanDrawing) -> str:
    """Switches for the layers that hold something, each with its line's look."""
    present = [name for name, content in _layers(drawing, _Pen(np.zeros(2))) if content]
    items = [
        f'<label><input type="checkbox" checked data-layer="{name}"><svg class="key" viewBox="0 0 24 10">'
        f'<g class="layer-{name}">{_key(name)}</g></svg>{escape(label)}</label>'
        for name, label in drawing.labels.items() if name in present
    ]  # fmt: skip
    return '<div class="legend">' + "".join(items) + "</div>"


def _key(layer: str) -> str:
    if layer in ("rooms-matched", "map-rooms"):
        return '<polygon points="3,1 21,1 21,9 3,9"/>'
    return '<polyline points="2,5 22,5"/>'


def _layers(drawing: PlanDrawing, pen: _Pen) -> list[tuple[str, str]]:
    """(name, content) from the lowest layer to the highest; a name may come twice."""

    def outlines(rooms: tuple[DrawnRoom, ...]) -> str:
        return "".join(pen.polygon(r.outline, r.title) for r in rooms if r.outline is not None)

    def walls(chosen: list[DrawnWall]) -> str:
        return "".join(pen.line(w.ends, w.title) for w in chosen)

    paths = {kind: pen.line(xy) for kind, xy in drawing.paths.items()}
    return [
        ("rooms-matched", outlines(tuple(r for r in drawing.bim_rooms if r.matched))),
        ("map-rooms", outlines(drawing.map_rooms)),
        ("bim-walls", walls(list(drawing.bim_walls))),
        ("walls-unmatched", walls([w for w in drawing.map_walls if not w.matched])),
        ("walls-matched", walls([w for w in drawing.map_walls if w.matched])),
        ("matches", "".join(pen.line(line) for line in drawing.match_lines)),
        ("odometry", paths.get("odometry", "")),
        ("trajectory", paths.get("trajectory", "") + _start_and_end(drawing, pen)),
        ("truth", paths.get("truth", "")),
        ("bim-walls", "".join(pen.text(r, -0.25) for r in drawing.bim_rooms)),
        ("map-rooms", "".join(pen.text(r, 0.95 if r.matched else 0.35) for r in drawing.map_rooms)),
    ]


def _start_and_end(drawing: PlanDrawing, pen: _Pen) -> str:
    if "trajectory" not in drawing.paths:
        return ""
    xy = drawing.paths["trajectory"]
    # lines without length, with round caps: dots whose size on the screen stays as they are zoomed
    dots = (("start", xy[0]), ("end", xy[-1]))
    return "".join(
        f'<polyline class="{name}" points="{pen.points(np.stack([p, p]))}">{_title(name)}</polyline>'
        for name, p in dots
    )


def _scale_bar(x: float, y: float, width: float) -> str:
    length = next((m for m in (50, 20, 10, 5, 2, 1) if m <= width / 6), 1)
    size = max(width / 90, 0.15)
    return (
        f'<g class="scale"><polyline points="{x:.3f},{y:.3f} {x + length:.3f},{y:.3f}"/>'
        f'<text x="{x + length + size / 2:.3f}" y="{y:.3f}" dy="0.35em" font-size="{size:.2f}">'
        f"{length} m</text></g>"
    )


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""
