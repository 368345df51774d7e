"""The floor plan as inline SVG: layers that can be switched, text that zooms, strokes of constant width."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from sgslam.as_built.deviation_bands import BANDS, LIMITS_MM, MINUS, band_labels
from sgslam.report.elements import VERDICTS, DrawnElement, slug
from sgslam.report.plan_drawing import DrawnRoom, DrawnWall, PlanDrawing

Array = NDArray[np.float64]
MARGIN = 0.03  # of the longer side


class Pen:
    """Converts metres (y up) to SVG coordinates: relative to the centre, y down, rounded to millimetres.

    Browsers draw in 32 bit floats, and a site may lie hundreds of kilometres from its model's origin.
    """

    def __init__(self, centre: Array) -> None:
        self.centre = centre

    def local(self, xy: Array) -> Array:
        """(N, 2) SVG coordinates."""
        return (xy.reshape(-1, 2) - self.centre) * [1, -1] + 0.0  # + 0.0 avoids minus zero

    def points(self, xy: Array) -> str:
        """The value of an attribute `points`."""
        return " ".join(f"{x:.3f},{y:.3f}" for x, y in self.local(xy))

    def line(self, ends: Array, title: str = "", attributes: str = "") -> str:
        """A line through `ends` (N, 2)."""
        return f'<polyline{attributes} points="{self.points(ends)}">{_title(title)}</polyline>'

    def wall(self, wall: DrawnWall) -> str:
        """A mapped wall in its band's colour; tables refer to it by `data-wall`."""
        looks = " ".join([f"band-{wall.band}"] * (wall.band is not None) + ["significant"] * wall.significant)
        attributes = f' class="{looks}"' if looks else ""
        return self.line(wall.ends, wall.title, f'{attributes} data-wall="{escape(wall.id)}"')

    def polygon(self, outline: Array, title: str = "") -> str:
        """A closed outline (K, 2)."""
        return f'<polygon points="{self.points(outline)}">{_title(title)}</polygon>'

    def element(self, element: DrawnElement) -> str:
        """A planned element in its verdict's colour; the table of elements refers to it by `data-element`."""
        looks = f"verdict-{slug(element.verdict)}{' flat' if element.flat else ''}"
        return (
            f'<polygon class="{looks}" data-element="{escape(element.global_id)}" '
            f'points="{self.points(element.outline)}">{_title(element.title)}</polygon>'
        )

    def area(self, outlines: Sequence[Array]) -> str:
        """The area within closed outlines (K, 2), of which holes run the other way round."""
        rings = "".join(f"M{self.points(outline)}Z" for outline in outlines)
        return f'<path d="{rings}"/>' if rings else ""

    def text(self, room: DrawnRoom, rise: float) -> str:
        """A room's name, moved down by `rise` times its size."""
        x, y = self.points(room.label).split(",")
        place = f'x="{x}" y="{y}" dy="{rise}em" font-size="{room.text_size():.2f}"'
        return f"<text {place}>{escape(room.name)}</text>"


def plan_svg(drawing: PlanDrawing, name: str = "plan") -> str:
    """The SVG element with the id `name`; only `#plan` has a marker.

    Layers that are not empty are groups `layer-NAME` (see `drawing.labels`).
    """
    pen = Pen(drawing.centre())
    margin, box = view_box(drawing, pen)
    groups = _layers(drawing, pen)
    body = "\n".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups if content)
    left, top, width, height = box
    scale = scale_bar(left + 0.4 * margin, top + height - 0.4 * margin, width)
    marker = '<g id="marker"><polyline/></g>' if name == "plan" else ""
    return (
        f'<svg id="{name}" class="plan" viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}" role="img" '
        f'aria-label="{escape(drawing.heading)}">\n{body}\n{scale}\n{marker}</svg>'
    )


def view_box(drawing: PlanDrawing, pen: Pen) -> tuple[float, tuple[float, float, float, float]]:
    """The margin around the drawing, and left, top, width and height including it."""
    low, high = drawing.bounds()
    margin = max(1.0, MARGIN * float((high - low).max()))
    (left, bottom), (right, top) = pen.local(low)[0], pen.local(high)[0]
    return margin, (left - margin, top - margin, right - left + 2 * margin, bottom - top + 2 * margin)


def legend(drawings: Sequence[PlanDrawing]) -> str:
    """Switches for the layers that are not empty in any drawing, each with its line style; the scale of deviations."""
    present = {name for one in drawings for name, content in _layers(one, Pen(np.zeros(2))) if content}
    items = [
        switch("layer", name, f'<g class="layer-{name}">{_key(name)}</g>', label)
        for name, label in drawings[0].labels.items() if name in present
    ]  # fmt: skip
    scale = deviation_scale() if any(one.with_deviations for one in drawings) else ""
    verdicts = verdict_scale() if any(one.elements for one in drawings) else ""
    return f'<div class="legend">{"".join(items)}</div>{verdicts}{scale}'


def switch(of: str, name: str, key: str, label: str) -> str:
    """A checkbox that shows and hides the layer `name`; `of` is the drawing's data attribute."""
    return (
        f'<label><input type="checkbox" checked data-{of}="{name}"><svg class="key" viewBox="0 0 24 10">'
        f"{key}</svg>{escape(label)}</label>"
    )


def deviation_scale() -> str:
    """The colours of mapped walls by their deviation from the plan."""
    labels = band_labels()
    swatches = "".join(
        f'<rect class="band-{band}" x="{60 * i}" width="60" height="10"><title>{labels[band]}</title></rect>'
        for i, band in enumerate(BANDS)
    )
    limits = [f"{MINUS}{mm}" for mm in reversed(LIMITS_MM)] + [f"+{mm}" for mm in LIMITS_MM]
    ticks = "".join(f'<text x="{60 * (i + 1)}" y="24">{text}</text>' for i, text in enumerate(limits))
    return (
        '<div class="deviation-scale"><span>Matched walls by their deviation from the plan (mm)</span>'
        f'<svg viewBox="0 0 420 28" role="img" aria-label="scale of the deviations">{swatches}{ticks}</svg>'
        "<span>below 0: set back from the room; above 0: into the room; thick: significant</span></div>"
    )


def verdict_scale() -> str:
    """The colours of planned elements by their verdicts."""
    keys = "".join(
        f'<span><svg class="key layer-elements" viewBox="0 0 24 10"><polygon class="verdict-{slug(verdict)}" '
        f'points="3,1 21,1 21,9 3,9"/></svg>{verdict}</span>'
        for verdict in VERDICTS
    )
    return f'<div class="legend"><span>Planned elements:</span>{keys}</div>'


def _key(layer: str) -> str:
    if layer in ("rooms-matched", "map-rooms", "uncertainty", "elements"):
        return '<polygon points="3,1 21,1 21,9 3,9"/>'
    return '<polyline points="2,5 22,5"/>'


def _layers(drawing: PlanDrawing, pen: Pen) -> list[tuple[str, str]]:
    """(name, content) from bottom to top; a name may occur twice."""

    def outlines(rooms: tuple[DrawnRoom, ...]) -> str:
        return "".join(pen.polygon(r.outline, r.title) for r in rooms if r.outline is not None)

    def walls(matched: bool) -> str:
        chosen = [w for w in drawing.map_walls if w.matched is matched]
        return "".join(pen.wall(w) for w in sorted(chosen, key=lambda w: w.significant))

    paths = {
        kind: "".join(pen.line(path.points[:, :2], path.title) for path in pieces)
        for kind, pieces in drawing.paths.items()
    }
    return [
        ("rooms-matched", outlines(tuple(r for r in drawing.bim_rooms if r.matched))),
        ("map-rooms", outlines(drawing.map_rooms)),
        ("uncertainty", pen.area(drawing.band)),
        ("bim-walls", "".join(pen.line(w.ends, w.title) for w in drawing.bim_walls)),
        ("elements", "".join(pen.element(e) for e in sorted(drawing.elements, key=lambda e: not e.flat))),
        ("anchors-withdrawn", "".join(pen.line(w.ends, w.title) for w in drawing.withdrawn)),
        ("walls-unmatched", walls(False)),
        ("walls-matched", walls(True)),
        ("matches", "".join(pen.line(line) for line in drawing.match_lines)),
        ("odometry", paths.get("odometry", "")),
        ("trajectory", paths.get("trajectory", "") + _start_and_end(drawing, pen)),
        ("lost", paths.get("lost", "")),
        ("truth", paths.get("truth", "")),
        ("bim-walls", "".join(pen.text(r, -0.25) for r in drawing.bim_rooms)),
        ("map-rooms", "".join(pen.text(r, 0.95 if r.matched else 0.35) for r in drawing.map_rooms)),
    ]


def _start_and_end(drawing: PlanDrawing, pen: Pen) -> str:
    if "trajectory" not in drawing.paths:
        return ""
    pieces = drawing.paths["trajectory"]
    # zero-length lines with round caps are dots of constant size on the screen
    dots = (("start", pieces[0].points[0, :2]), ("end", pieces[-1].points[-1, :2]))
    return "".join(pen.line(np.stack([p, p]), name, f' class="{name}"') for name, p in dots)


def scale_bar(x: float, y: float, width: float) -> str:
    """A round number of metres, at most a sixth of the drawing's width, from a point in SVG coordinates."""
    length = next((m for m in (50, 20, 10, 5, 2, 1) if m <= width / 6), 1)
    size = max(width / 90, 0.15)
    return (
        f'<g class="scale"><polyline points="{x:.3f},{y:.3f} {x + length:.3f},{y:.3f}"/>'
        f'<text x="{x + length + size / 2:.3f}" y="{y:.3f}" dy="0.35em" font-size="{size:.2f}">'
        f"{length} m</text></g>"
    )


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""
