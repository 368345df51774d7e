"""`plan.png`: the floor plan drawn with matplotlib, without a display."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from data.common.files import write_atomically
from sgslam.as_built.deviation_bands import BANDS, band_labels
from sgslam.report.contents import ReportData, split_by_floor
from sgslam.report.drawn_paths import PathKind
from sgslam.report.plan_drawing import PlanDrawing, plan_drawing

LONG_SIDE_INCH, NARROWEST_INCH, LEGEND_COLUMN_INCH, LEGEND_LINE_INCH, DPI = 12.0, 6.0, 3.1, 0.22, 150
MARGIN = 0.03  # of the longer side
LARGEST_TEXT, SMALLEST_TEXT = 9.0, 3.0  # points; smaller names are left out
BIM, ROOM, MATCHED, UNMATCHED = "#a3a9b2", "#e7f3f1", "#0f8a7b", "#c0508c"
BAND_COLORS = ("#1f4aa8", "#4f86d4", "#8fbbe8", MATCHED, "#eeb04e", "#dd7a1c", "#b03a10")
PATHS: dict[PathKind, dict[str, Any]] = {
    "odometry": {"color": "#a78bfa", "lw": 1.1, "ls": (0, (4, 3))},
    "truth": {"color": "#1c1f23", "lw": 0.8, "ls": ":"},
    "trajectory": {"color": "#6d28d9", "lw": 1.6},
    "lost": {"color": "#767f8a", "lw": 1.8},
}
STYLES: dict[str, dict[str, Any]] = {  # of the layers that are drawn
    "rooms-matched": {"fc": ROOM, "ec": "none"},
    "map-rooms": {"fc": "none", "ec": MATCHED, "lw": 0.7, "ls": (0, (2, 2)), "alpha": 0.6},
    "bim-walls": {"color": BIM, "lw": 3.2},
    "anchors-withdrawn": {"color": "#ec8288", "lw": 7.0},
    "walls-unmatched": {"color": UNMATCHED, "lw": 1.6},
    "walls-matched": {"color": MATCHED, "lw": 1.6},
    "matches": {"color": MATCHED, "lw": 0.6},
    **{str(kind): style for kind, style in PATHS.items()},
}
UNCERTAIN, SIGNIFICANT = "#e2d4f7", 2.0  # colour of the band, and how much wider a significant wall is


def write_plan_png(data: ReportData, path: Path | str) -> None:
    """Draws the plan from above (metres, the BIM frame where there is one) and writes it atomically."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    drawings = [plan_drawing(part) for part in split_by_floor(data)]
    corners = [drawing.bounds() for drawing in drawings]
    low, high = np.min([a for a, _ in corners], axis=0), np.max([b for _, b in corners], axis=0)
    margin = max(0.5, MARGIN * float(max(high - low)))
    width, height = np.maximum(high - low + 2 * margin, 1.0)
    scale = LONG_SIDE_INCH / max(width, height)
    wide = max(width * scale + 1, NARROWEST_INCH)
    figure = Figure(layout=ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.15))
    FigureCanvasAgg(figure)
    frame = "BIM" if data.a_graph is not None else "map"
    known: dict[str, Any] = {}  # legend entries by label
    for k, drawing in enumerate(drawings):
        axes = figure.add_subplot(len(drawings), 1, k + 1)
        draw_plan(axes, drawing)
        draw_names(axes, drawing, points_per_metre=72 * scale)
        axes.set_xlim(low[0] - margin, high[0] + margin)
        axes.set_ylim(low[1] - margin, high[1] + margin)
        _axes(axes, drawing.heading, frame)
        known |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    columns = int(min(wide // LEGEND_COLUMN_INCH, 4))  # as many as fit side by side
    below = 1.2 + LEGEND_LINE_INCH * math.ceil(len(known) / columns)
    figure.set_size_inches(wide, len(drawings) * max(height * scale, 4.0) + below)
    figure.legend(
        list(known.values()), list(known), loc="outside lower center", ncols=columns, fontsize=9, frameon=False
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    write_atomically(path, buffer.getvalue())


def _axes(axes: Any, heading: str, frame: str) -> None:
    axes.set_aspect("equal")
    axes.set_title(heading, loc="left", fontsize=12, parse_math=False)
    axes.set_xlabel(f"x in the {frame} frame (m)")
    axes.set_ylabel(f"y in the {frame} frame (m)")
    axes.ticklabel_format(useOffset=False)
    axes.tick_params(labelsize=8, color="#c4c9cf")
    axes.spines[:].set_color("#c4c9cf")


def draw_plan(axes: Any, drawing: PlanDrawing) -> None:
    """Draws walls, rooms and paths."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    if drawing.band:
        area = Outline.make_compound_path(*(Outline(outline, closed=True) for outline in drawing.band))
        axes.add_patch(PathPatch(area, fc=UNCERTAIN, ec="none", label=drawing.labels["uncertainty"]))
    bands = {f"band-{band}": color for band, color in zip(BANDS, BAND_COLORS, strict=True)}
    labels = {f"band-{band}": f"mapped wall, {text}" for band, text in band_labels().items()}
    for layer, marks in drawing.layers():
        style = STYLES.get(layer)
        if style is None:
            continue
        looks = (None, *bands) if layer == "walls-matched" else (None,)
        for look in looks:
            own = [m for m in marks if look in m.looks or (look is None and bands.keys().isdisjoint(m.looks))]
            if not own:
                continue
            known = style if look is None else style | {"color": bands[look]}
            if "significant" in {name for m in own for name in m.looks} and look is not None:
                known = known | {"lw": [style["lw"] * (SIGNIFICANT if "significant" in m.looks else 1) for m in own]}
            kind = PolyCollection if own[0].closed else LineCollection
            label = drawing.labels[layer] if look is None else labels[look]
            axes.add_collection(kind([m.points for m in own], label=label, **known))
    if "trajectory" in drawing.paths:
        start = drawing.paths["trajectory"][0].points[0, :2]
        axes.plot(*start, "o", ms=6, color=PATHS["trajectory"]["color"], mec="white", label="start")


def draw_names(axes: Any, drawing: PlanDrawing, points_per_metre: float) -> None:
    """Writes the names of the rooms, as large as they fit at this scale."""
    for rooms, color, of_map in ((drawing.bim_rooms, "#6b7280", False), (drawing.map_rooms, MATCHED, True)):
        for room in rooms:
            size = min(room.text_size() * points_per_metre, LARGEST_TEXT)
            if size < SMALLEST_TEXT:
                continue
            side = "top" if of_map and room.matched else "center" if of_map else "bottom"
            # parse_math: a dollar sign in a name starts no formula
            style = {
                "va": side,
                "ha": "center",
                "fontsize": size,
                "color": color,
                "parse_math": False,
                "in_layout": False,
            }
            axes.text(*room.label, room.name, **style)
