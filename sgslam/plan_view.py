"""`plan.png`: the plan from above with matplotlib, without a display."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from data.files import write_atomically
from sgslam.plan_drawing import PlanDrawing, ReportData, plan_drawing

LONG_SIDE_INCH, DPI = 12.0, 150
LARGEST_TEXT, SMALLEST_TEXT = 9.0, 3.0  # points; a name that would be smaller is left out
BIM, ROOM, MATCHED, UNMATCHED = "#a3a9b2", "#e7f3f1", "#0f8a7b", "#d96c1a"
PATHS: dict[str, dict[str, Any]] = {
    "odometry": {"color": "#8b5cf6", "lw": 1.1, "ls": (0, (4, 3))},
    "truth": {"color": "#1c1f23", "lw": 0.8, "ls": ":"},
    "trajectory": {"color": "#2563eb", "lw": 1.6, "ls": "-"},
}


def write_plan_png(data: ReportData, path: Path | str) -> None:
    """Draws the plan from above (metres, the BIM frame where there is one) and writes it atomically."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # imported here: a third of a second
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    drawing = plan_drawing(data)
    low, high = drawing.bounds()
    width, height = np.maximum(high - low, 1.0)
    scale = LONG_SIDE_INCH / max(width, height)
    size = (max(width * scale, 5.0) + 1, max(height * scale, 4.0) + 1.6)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.15))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw(axes, drawing)
    _names(axes, drawing, points_per_metre=72 * scale)
    axes.set_aspect("equal")
    axes.set_title(drawing.heading, loc="left", fontsize=12, parse_math=False)
    frame = "BIM" if data.a_graph is not None else "map"
    axes.set_xlabel(f"x in the {frame} frame (m)")
    axes.set_ylabel(f"y in the {frame} frame (m)")
    axes.ticklabel_format(useOffset=False)
    axes.tick_params(labelsize=8, color="#c4c9cf")
    axes.spines[:].set_color("#c4c9cf")
    figure.legend(loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    write_atomically(path, buffer.getvalue())


def _draw(axes: Any, drawing: PlanDrawing) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    fills: dict[str, tuple[list[Any], dict[str, Any]]] = {
        "rooms-matched": ([r.outline for r in drawing.bim_rooms if r.matched], {"fc": ROOM, "ec": "none"}),
        "map-rooms": (
            [r.outline for r in drawing.map_rooms],
            {"fc": "none", "ec": MATCHED, "lw": 0.7, "ls": (0, (2, 2)), "alpha": 0.6},
        ),
    }
    for layer, (outlines, style) in fills.items():
        if known := [outline for outline in outlines if outline is not None]:
            axes.add_collection(PolyCollection(known, label=drawing.labels[layer], **style))
    lines = {
        "bim-walls": ([w.ends for w in drawing.bim_walls], BIM, 3.2),
        "walls-unmatched": ([w.ends for w in drawing.map_walls if not w.matched], UNMATCHED, 1.6),
        "walls-matched": ([w.ends for w in drawing.map_walls if w.matched], MATCHED, 1.6),
        "matches": (list(drawing.match_lines), MATCHED, 0.6),
    }
    for layer, (ends, color, width) in lines.items():
        if ends:
            collection = LineCollection(ends, colors=color, linewidths=width, label=drawing.labels[layer])
            axes.add_collection(collection)
    for kind, xy in drawing.paths.items():
        axes.plot(*xy.T, label=drawing.labels[kind], **PATHS[kind])
    if "trajectory" in drawing.paths:
        axes.plot(*drawing.paths["trajectory"][0], "o", ms=6, color="#2563eb", mec="white", label="start")
    axes.autoscale_view()


def _names(axes: Any, drawing: PlanDrawing, points_per_metre: float) -> None:
    for rooms, color, of_map in ((drawing.bim_rooms, "#6b7280", False), (drawing.map_rooms, MATCHED, True)):
        for room in rooms:
            size = min(room.text_size() * points_per_metre, LARGEST_TEXT)
            if size < SMALLEST_TEXT:
                continue
            side = "top" if of_map and room.matched else "center" if of_map else "bottom"
            # parse_math: a name with a dollar sign is no formula
            style = {"va": side, "ha": "center", "fontsize": size, "color": color, "parse_math": False}
            axes.text(*room.label, room.name, **style)
