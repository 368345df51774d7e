"""Plans as inline SVG: layers that can be switched, text that zooms, strokes of constant width."""

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from sgslam.report.plan_drawing import DrawnRoom, Layers, Mark, PlanDrawing

Array = NDArray[np.float64]
Groups = Iterable[tuple[str, str]]  # names of layers and their SVG, from bottom to top
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

    def mark(self, mark: Mark) -> str:
        """A line or an area."""
        shape = "polygon" if mark.closed else "polyline"
        looks = f' class="{" ".join(mark.looks)}"' if mark.looks else ""
        refers = f' data-{mark.refers[0]}="{escape(mark.refers[1])}"' if mark.refers else ""
        title = f"<title>{escape(mark.title)}</title>" if mark.title else ""
        return f'<{shape}{looks}{refers} points="{self.points(mark.points)}">{title}</{shape}>'

    def groups(self, layers: Layers) -> list[tuple[str, str]]:
        """Layers as SVG."""
        return [(name, "".join(map(self.mark, marks))) for name, marks in layers]

    def area(self, outlines: Sequence[Array]) -> str:
        """The area within closed outlines (K, 2), of which holes run the other way round."""
        rings = "".join(f"M{self.points(outline)}Z" for outline in outlines)
        return f'<path d="{rings}"/>' if rings else ""

    def text(self, place: Array, text: str, size: float, rise: float, look: str = "") -> str:
        """Text of a height (m), moved down from its place (2,) by `rise` times its size."""
        (x, y), looks = self.local(place)[0], f' class="{look}"' if look else ""
        return f'<text{looks} x="{x:.3f}" y="{y:.3f}" dy="{rise}em" font-size="{size:.2f}">{escape(text)}</text>'

    def names(self, rooms: Iterable[DrawnRoom], rise: float) -> str:
        """The names of rooms."""
        return "".join(self.text(r.label, r.name, r.text_size(), rise) for r in rooms)


def plan_svg(drawing: PlanDrawing, name: str = "plan") -> str:
    """The SVG element with the id `name`; only `#plan` has a marker.

    Layers that are not empty are groups `layer-NAME` (see `drawing.labels`).
    """
    pen = Pen(drawing.centre())
    marker = '<g id="marker"><polyline/></g>' if name == "plan" else ""
    named = f'id="{name}" class="plan" role="img" aria-label="{escape(drawing.heading)}"'
    return svg_figure(plan_groups(drawing, pen), pen, drawing.bounds(), named, marker)


def plan_groups(drawing: PlanDrawing, pen: Pen) -> list[tuple[str, str]]:
    """The layers of a plan; a name may occur twice."""
    matched, others = ([r for r in drawing.map_rooms if r.matched is own] for own in (True, False))
    first, second, *others_above = pen.groups(drawing.layers())
    return [
        first, second, ("uncertainty", pen.area(drawing.band)), *others_above,
        ("bim-walls", pen.names(drawing.bim_rooms, -0.25)),
        ("map-rooms", pen.names(matched, 0.95) + pen.names(others, 0.35)),
    ]  # fmt: skip


def svg_figure(groups: Groups, pen: Pen, bounds: tuple[Array, Array], attributes: str, more: str = "") -> str:
    """The SVG element of what lies within `bounds` (m, lower left and upper right), with a scale bar."""
    low, high = bounds
    margin = max(1.0, MARGIN * float((high - low).max()))
    left, top = pen.local(np.array([low[0], high[1]]))[0] - margin
    width, height = high - low + 2 * margin
    body = "\n".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups if content)
    x, y = left + 0.4 * margin, top + height - 0.4 * margin
    length = next((m for m in (50, 20, 10, 5, 2, 1) if m <= width / 6), 1)
    size = max(width / 90, 0.15)
    return (
        f'<svg {attributes} viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}">\n{body}\n'
        f'<g class="scale"><polyline points="{x:.3f},{y:.3f} {x + length:.3f},{y:.3f}"/>'
        f'<text x="{x + length + size / 2:.3f}" y="{y:.3f}" dy="0.35em" font-size="{size:.2f}">{length} m</text></g>'
        f"\n{more}</svg>"
    )


def present_layers(drawings: Sequence[PlanDrawing]) -> dict[str, str]:
    """The labels of the layers that are not empty in any drawing."""
    groups = [group for one in drawings for group in plan_groups(one, Pen(np.zeros(2)))]
    present = {name for name, content in groups if content}
    return {name: label for name, label in drawings[0].labels.items() if name in present}
