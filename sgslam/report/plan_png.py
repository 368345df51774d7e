"""`plan.png`: the floor plan drawn with matplotlib, without a display."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from data.common.files import write_atomically
from sgslam.as_built.deviation_bands import BANDS, band_labels
from sgslam.report.contents import ReportData, split_by_floor
from sgslam.report.drawn_paths import Mark
from sgslam.report.plan_drawing import PlanDrawing, plan_drawing

LARGEST_TEXT, SMALLEST_TEXT = 9.0, 3.0  # points; smaller names are left out
BIM, ROOM, MATCHED, UNMATCHED = "#a3a9b2", "#e7f3f1", "#0f8a7b", "#c0508c"
BAND_COLORS = ("#1f4aa8", "#4f86d4", "#8fbbe8", MATCHED, "#eeb04e", "#dd7a1c", "#b03a10")
PATHS: dict[str, dict[str, Any]] = {
    "odometry": {"color": "#a78bfa", "lw": 1.1, "ls": (0, (4, 3))},
    "trajectory": {"color": "#6d28d9", "lw": 1.6},
    "lost": {"color": "#767f8a", "lw": 1.8},
    "truth": {"color": "#1c1f23", "lw": 0.8, "ls": ":"},
}
STYLES: dict[str, dict[str, Any]] = {  # of the layers that are drawn
    "rooms-matched": {"fc": ROOM, "ec": "none"},
    "uncertainty": {"fc": "#e2d4f7", "ec": "none"},
    "map-rooms": {"fc": "none", "ec": MATCHED, "lw": 0.7, "ls": (0, (2, 2)), "alpha": 0.6},
    "bim-walls": {"color": BIM, "lw": 3.2},
    "anchors-withdrawn": {"color": "#ec8288", "lw": 7.0},
    "walls-unmatched": {"color": UNMATCHED, "lw": 1.6},
    "walls-matched": {"color": MATCHED, "lw": 1.6},
    **PATHS,
}
_WIDER = 2.0  # is a significant wall


def write_plan_png(data: ReportData, path: Path | str) -> None:
    """Draws the plan from above (metres, the BIM frame where there is one) and writes it atomically."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import
    from matplotlib.figure import Figure

    drawings = [plan_drawing(part) for part in split_by_floor(data)]
    corners = [drawing.bounds() for drawing in drawings]
    low, high = np.min([a for a, _ in corners], axis=0), np.max([b for _, b in corners], axis=0)
    margin = max(0.5, 0.03 * float(max(high - low)))
    width, height = np.maximum(high - low + 2 * margin, 1.0)
    scale = 12.0 / max(width, height)  # inches per metre
    wide, tall = max(width * scale + 1, 6.0), max(height * scale, 4.0)
    columns = max(round((len(drawings) * tall / wide) ** 0.5), 1)  # many storeys make about a square
    rows = -(-len(drawings) // columns)
    figure = Figure(figsize=(columns * wide, rows * tall), layout="constrained")
    FigureCanvasAgg(figure)
    frame = "BIM" if data.a_graph is not None else "map"
    known: dict[str, Any] = {}  # legend entries by label
    for k, drawing in enumerate(drawings):
        axes = figure.add_subplot(rows, columns, k + 1)
        draw_plan(axes, drawing)
        draw_names(axes, drawing, points_per_metre=72 * scale)
        axes.set_xlim(low[0] - margin, high[0] + margin)
        axes.set_ylim(low[1] - margin, high[1] + margin)
        _axes(axes, drawing.heading, frame)
        known |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0)}  # as many columns as fit side by side
    figure.legend(
        [*known.values()], [*known], ncols=int(min(columns * wide // 3, 4)), fontsize=9, frameon=False, **below
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, bbox_inches="tight", pad_inches=0.15)
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
    from matplotlib.collections import LineCollection, PolyCollection

    bands = {f"band-{band}": color for band, color in zip(BANDS, BAND_COLORS, strict=True)}
    texts = {f"band-{band}": f"mapped wall, {text}" for band, text in band_labels().items()}
    for layer, style in STYLES.items():
        of_look: dict[str, list[Mark]] = {}
        for mark in drawing.layers[layer]:
            look = next((look for look in mark.looks if look in bands), "")
            of_look.setdefault(look, []).append(mark)
        for look in ("", *bands):
            if not (marks := of_look.get(look)):
                continue
            known = style | ({"color": bands[look]} if look else {})
            if not marks[0].closed:
                known["lw"] = [style["lw"] * (_WIDER if "significant" in mark.looks else 1.0) for mark in marks]
            kind = PolyCollection if marks[0].closed else LineCollection
            label = texts[look] if look else drawing.labels[layer]
            axes.add_collection(kind([mark.points for mark in marks], label=label, **known))
    if way := drawing.layers["trajectory"]:
        start = way[0].points[0]
        axes.plot(*start, "o", ms=6, color=PATHS["trajectory"]["color"], mec="white", label="start")


def draw_names(axes: Any, drawing: PlanDrawing, points_per_metre: float) -> None:
    """Writes the names of the rooms, as large as they fit at this scale."""
    for name in drawing.names:
        size = min(name.size * points_per_metre, LARGEST_TEXT)
        if size < SMALLEST_TEXT:
            continue
        side = "bottom" if name.rise < 0 else "top" if name.rise > 0.5 else "center"
        color = "#6b7280" if name.layer == "bim-walls" else MATCHED
        # parse_math: a dollar sign in a name starts no formula
        style = {"va": side, "ha": "center", "fontsize": size, "color": color}
        axes.text(*name.place, name.text, parse_math=False, in_layout=False, **style)
