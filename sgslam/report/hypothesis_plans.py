"""Small plans of the matcher's hypotheses, each drawn on its storey, the best first."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sgslam.as_built.deviation_bands import MINUS
from sgslam.report.contents import ReportData, hypothesis_pose
from sgslam.report.plan_drawing import PlanDrawing, mapped_walls, planned_room, planned_walls
from sgslam.report.plan_svg import Pen, svg_figure

SHOWN = 4


@dataclass(frozen=True)
class HypothesisFigure:
    """One hypothesis: its texts, how many of the plan's rooms are matched, and the SVG."""

    storey: str
    score: str
    place: str
    rooms: int
    svg: str


def hypothesis_figures(data: ReportData) -> list[HypothesisFigure]:
    """The figures of the best hypotheses, at one scale; empty where there are none, or no BIM."""
    if data.a_graph is None or not data.hypotheses:
        return []
    drawings = [_drawing(data, hypothesis) for hypothesis in data.hypotheses[:SHOWN]]
    corners = np.array([drawing.bounds() for drawing in drawings])
    bounds = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    pen = Pen(np.round((bounds[0] + bounds[1]) / 2))
    return [
        HypothesisFigure(
            *hypothesis_texts(data, hypothesis), len({a for _, a in hypothesis.get("rooms") or ()}),
            svg_figure(pen.groups(drawing.layers()), pen, bounds, f'role="img" aria-label="hypothesis {number}"'),
        )
        for number, (hypothesis, drawing) in enumerate(zip(data.hypotheses, drawings, strict=False), 1)
    ]  # fmt: skip


def _drawing(data: ReportData, hypothesis: dict[str, Any]) -> PlanDrawing:
    """The storey with the map on it; a mapped wall counts as matched if its room is."""
    pairs, floor = hypothesis.get("rooms") or (), data.floor_named(hypothesis.get("floor"))
    taken_s, taken_a = {s for s, _ in pairs}, {a for _, a in pairs}
    seen_in = {w.id: w.room for w in data.s_graph.wall_surfaces}
    ours = mapped_walls(data, hypothesis_pose(data, hypothesis["T_a_s"], floor), 0.0)
    rooms = [r for r in (data.a_graph.rooms if data.a_graph else ()) if r.id in taken_a]
    return PlanDrawing(
        "", planned_walls(data, floor, 0.0), tuple(planned_room(room, matched=True) for room in rooms),
        tuple(replace(wall, matched=seen_in[wall.id] in taken_s, band=None, significant=False) for wall in ours),
    )  # fmt: skip


def hypothesis_texts(data: ReportData, hypothesis: dict[str, Any]) -> tuple[str, str, str]:
    """The storey's name, the score, and the pose of the map's origin."""
    floor_id = hypothesis.get("floor")
    floor = data.floor_named(floor_id)
    storey = (floor.name or floor.id) if floor else str(floor_id or "the plan")
    yaw, x, y = hypothesis["T_a_s"]
    turn = (math.degrees(yaw) + 180) % 360 - 180
    place = f"{x:.2f}, {y:.2f} m, {turn:.1f}°"
    return storey, f"{hypothesis['score']:.1f}".replace("-", MINUS), place.replace("-", MINUS)
