"""`plan.png`: the floor plan drawn with matplotlib, without a display."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from data.common.files import write_atomically
from sgslam.as_built.deviation_bands import BANDS, band_labels
from sgslam.report.contents import ReportData, split_by_floor
from sgslam.report.drawn_paths import PathKind
from sgslam.report.plan_drawing import DrawnWall, PlanDrawing, plan_drawing

LONG_SIDE_INCH, LEGEND_INCH, DPI = 12.0, 2.3, 150
MARGIN = 0.03  # of the longer side
LARGEST_TEXT, SMALLEST_TEXT = 9.0, 3.0  # points; smaller names are left out
BIM, ROOM, MATCHED, UNMATCHED = "#a3a9b2", "#e7f3f1", "#0f8a7b", "#c0508c"
LOST, WITHDRAWN, BAND = "#767f8a", "#ec8288", "#e2d4f7"
BAND_COLORS = ("#1f4aa8", "#4f86d4", "#8fbbe8", MATCHED, "#eeb04e", "#dd7a1c", "#b03a10")
PATHS: dict[PathKind, dict[str, Any]] = {  # from bottom to top
    "odometry": {"color": "#a78bfa", "lw": 1.1, "ls": (0, (4, 3))},
    "truth": {"color": "#1c1f23", "lw": 0.8, "ls": ":"},
    "trajectory": {"color": "#6d28d9", "lw": 1.6, "ls": "-"},
    "lost": {"color": LOST, "lw": 1.8, "ls": "-"},
}


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
    size = (max(width * scale, 5.0) + 1, len(drawings) * max(height * scale, 4.0) + LEGEND_INCH)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.15))
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
    figure.legend(list(known.values()), list(known), loc="outside lower center", ncols=4, fontsize=9, frameon=False)
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
    matched = [w for w in drawing.map_walls if w.matched]
    _uncertainty(axes, drawing)
    for layer, walls, color, width in (
        ("bim-walls", list(drawing.bim_walls), BIM, 3.2),
        ("anchors-withdrawn", list(drawing.withdrawn), WITHDRAWN, 7.0),
        ("walls-unmatched", [w for w in drawing.map_walls if not w.matched], UNMATCHED, 1.6),
        ("walls-matched", [w for w in matched if w.band is None], MATCHED, 1.6),
    ):
        _lines(axes, walls, color, width, drawing.labels[layer])
    for band, color in zip(BANDS, BAND_COLORS, strict=True):
        off = [w for w in matched if w.band == band]
        _lines(axes, off, color, [3.2 if w.significant else 1.6 for w in off], f"mapped wall, {band_labels()[band]}")
    if len(drawing.match_lines):
        ends, label = list(drawing.match_lines), drawing.labels["matches"]
        axes.add_collection(LineCollection(ends, colors=MATCHED, linewidths=0.6, label=label))
    for kind, style in PATHS.items():
        for path in drawing.paths.get(kind, ()):
            axes.plot(*path.points[:, :2].T, label=drawing.labels[kind], **style)
    if "trajectory" in drawing.paths:
        start = drawing.paths["trajectory"][0].points[0, :2]
        axes.plot(*start, "o", ms=6, color=PATHS["trajectory"]["color"], mec="white", label="start")


def _uncertainty(axes: Any, drawing: PlanDrawing) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    if drawing.band:
        area = Outline.make_compound_path(*(Outline(outline, closed=True) for outline in drawing.band))
        axes.add_patch(PathPatch(area, fc=BAND, ec="none", label=drawing.labels["uncertainty"]))


def _lines(axes: Any, walls: list[DrawnWall], color: str, widths: float | list[float], label: str) -> None:
    from matplotlib.collections import LineCollection

    if walls:
        ends = [w.ends for w in walls]
        axes.add_collection(LineCollection(ends, colors=color, linewidths=widths, label=label))


def draw_names(axes: Any, drawing: PlanDrawing, points_per_metre: float) -> None:
    """Writes the names of the rooms, as large as they fit at this scale."""
    for rooms, color, of_map in ((drawing.bim_rooms, "#6b7280", False), (drawing.map_rooms, MATCHED, True)):
        for room in rooms:
            size = min(room.text_size() * points_per_metre, LARGEST_TEXT)
            if size < SMALLEST_TEXT:
                continue
            side = "top" if of_map and room.matched else "center" if of_map else "bottom"
            # parse_math: a dollar sign in a name starts no formula
            style = {"va": side, "ha": "center", "fontsize": size, "color": color, "parse_math": False}
            axes.text(*room.label, room.name, **style)
