"""A sheet for each storey: its plan, with the elements in the colours of their verdicts."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sgslam.report.contents import ReportData, split_by_floor
from sgslam.report.elements import VERDICTS
from sgslam.report.pdf.sheet import BOTTOM, MARGIN, MUTED, TOP, VERDICT_COLORS, Sheet, text_width
from sgslam.report.plan_drawing import PlanDrawing, plan_drawing
from sgslam.report.plan_png import draw_names, draw_plan

_MARGIN = 0.02  # of the plan's longer side
_NUMBERED = ("moved", "absent", "unplanned", "uncertain")


def plan_sheets(data: ReportData, numbers: Mapping[str, int]) -> list[Sheet]:
    """`numbers` are those of the elements in the table, by GlobalId."""
    return [_sheet(plan_drawing(part), numbers) for part in split_by_floor(data)]


def _sheet(drawing: PlanDrawing, numbers: Mapping[str, int]) -> Sheet:
    sheet = Sheet()
    sheet.text(MARGIN, TOP, drawing.heading, 12.0, weight="bold")
    axes = sheet.axes(TOP + 22, BOTTOM - 22)
    axes.set_aspect("equal")
    axes.axis("off")
    low, high = drawing.bounds()
    margin = max(0.5, _MARGIN * float(max(high - low)))
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    if drawing.elements:
        _elements(axes, drawing, numbers)
        _legend(sheet)
        drawing = replace(drawing, map_rooms=())  # the names of the plan suffice
    else:
        draw_plan(axes, drawing)
    axes.apply_aspect()  # only now is the scale known
    draw_names(axes, drawing, 72 * axes.get_window_extent().width / sheet.figure.dpi / (high[0] - low[0] + 2 * margin))
    return sheet


def _elements(axes: Any, drawing: PlanDrawing, numbers: Mapping[str, int]) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    walls = [wall.ends for wall in drawing.bim_walls]
    axes.add_collection(LineCollection(walls, colors="#c4c9cf", linewidths=0.6))
    for verdict in reversed(VERDICTS):  # what needs a look lies on top
        own = [element for element in drawing.elements if element.verdict == verdict and not element.flat]
        color, seen = VERDICT_COLORS[verdict], verdict != "not seen"
        alpha = 0.55 if seen else 0.12
        outlines = [element.outline for element in own]
        axes.add_collection(PolyCollection(outlines, fc=color, alpha=alpha, ec=color, lw=0.5, ls="-" if seen else ":"))
        for element in own if verdict in _NUMBERED else ():
            _number(axes, np.mean(element.outline, axis=0), numbers.get(element.global_id), color)
    for path in drawing.paths.get("trajectory", ()):
        axes.plot(*path.points[:, :2].T, color="#6d28d9", lw=0.8)


def _number(axes: Any, place: Any, number: int | None, color: str) -> None:
    if number is not None:
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": color, "lw": 0.5}
        axes.text(*place, str(number), fontsize=5.5, color=color, ha="center", va="center", bbox=box, zorder=9)


def _legend(sheet: Sheet) -> None:
    x, y = MARGIN, BOTTOM - 12
    for verdict in VERDICTS:
        sheet.box(x, y + 1.5, 12.0, 6.0, VERDICT_COLORS[verdict])
        sheet.text(x + 17, y, verdict, 8.0)
        x += 35 + text_width(verdict, 8.0)
    sheet.text(x, y, "numbers as in the table; violet: the path of the sensor", 8.0, MUTED)
