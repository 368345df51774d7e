"""Plans as inline SVG: layers that can be switched, text that zooms, strokes of constant width."""

from html import escape
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from sgslam.report.drawn_paths import Mark
from sgslam.report.plan_drawing import Name, PlanDrawing

Array = NDArray[np.float64]


def _local(points: Array, centre: Array) -> Array:
    """(N, 2) SVG coordinates of metres (N, 2), y up: relative to the centre, y down.

    Browsers draw in 32 bit floats, and a site may lie hundreds of kilometres from its model's origin.
    """
    return (points - centre) * [1, -1] + 0.0  # + 0.0 avoids minus zero


def _mark(mark: Mark, centre: Array) -> str:
    """A line or an area, rounded to millimetres."""
    shape = "polygon" if mark.closed else "polyline"
    looks = f' class="{" ".join(mark.looks)}"' if mark.looks else ""
    element = f' data-element="{escape(mark.element)}"' if mark.element else ""
    title = f"<title>{escape(mark.title)}</title>" if mark.title else ""
    points = " ".join(f"{x:.3f},{y:.3f}" for x, y in _local(mark.points, centre))
    return f'<{shape}{looks}{element} points="{points}">{title}</{shape}>'


def _name(name: Name, centre: Array) -> str:
    ((x, y),), look = _local(name.place[None], centre), f' class="{name.look}"' if name.look else ""
    place = f'x="{x:.3f}" y="{y:.3f}" dy="{name.rise}em" font-size="{name.size:.2f}"'
    return f"<text{look} {place}>{escape(name.text)}</text>"


def plan_svg(drawing: PlanDrawing, attributes: str = 'class="plan"') -> str:
    """The SVG element with these `attributes` and a scale bar. Layers that are not empty are groups
    `layer-NAME`; a name may occur twice."""
    low, high = drawing.bounds()
    centre = np.round((low + high) / 2)
    groups = [(layer, "".join(_mark(mark, centre) for mark in marks)) for layer, marks in drawing.layers.items()]
    if way := drawing.layers.get("trajectory"):  # lines of no length: dots
        ends = (("start", way[0].points[:1]), ("end", way[-1].points[-1:]))
        dots = [Mark(np.repeat(place, 2, axis=0), name, looks=(name,)) for name, place in ends]
        groups.append(("trajectory", "".join(_mark(dot, centre) for dot in dots)))
    for layer, names in groupby(drawing.names, key=lambda name: name.layer):
        groups.append((layer, "".join(_name(name, centre) for name in names)))
    body = "\n".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups if content)
    margin = max(1.0, 0.03 * float((high - low).max()))
    left, top = _local(np.array([[low[0], high[1]]]), centre)[0] - margin
    width, height = high - low + 2 * margin
    x, y = left + 0.4 * margin, top + height - 0.4 * margin
    length = next((m for m in (50, 20, 10, 5, 2, 1) if m <= width / 6), 1)
    size = max(width / 90, 0.15)
    return (
        f'<svg {attributes} role="img" aria-label="{escape(drawing.heading)}"'
        f' viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}">\n{body}\n'
        f'<g class="scale" font-size="{size:.2f}"><polyline points="{x:.3f},{y:.3f} {x + length:.3f},{y:.3f}"/>'
        f'<text x="{x + length + size / 2:.3f}" y="{y:.3f}" dy="0.35em">{length} m</text></g>'
        "\n</svg>"
    )
