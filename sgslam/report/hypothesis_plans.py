"""Small plans of the matcher's hypotheses, each drawn on its storey, the best first."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.as_built.deviation_bands import MINUS
from sgslam.report.contents import ReportData, hypothesis_pose
from sgslam.report.plan_drawing import DrawnWall, mapped_walls, planned_walls
from sgslam.report.plan_svg import Pen

Array = NDArray[np.float64]
SHOWN = 4
MARGIN = 0.03


@dataclass(frozen=True)
class HypothesisFigure:
    """One hypothesis: its texts, how many of the plan's rooms are matched, the SVG's viewBox and its layers from bottom
    to top."""

    storey: str
    score: str
    place: str
    rooms: int
    box: str
    layers: dict[str, str]


def hypothesis_figures(data: ReportData) -> list[HypothesisFigure]:
    """The figures of the best hypotheses, at one scale; empty where there are none, or no BIM."""
    shown = data.hypotheses[:SHOWN]
    if data.a_graph is None or not shown:
        return []
    sides = []
    for hypothesis in shown:
        floor = data.floor_named(hypothesis.get("floor"))
        ours = mapped_walls(data, hypothesis_pose(data, hypothesis["T_a_s"], floor), 0.0)
        sides.append((planned_walls(data, floor, 0.0), ours))
    ends = np.vstack([w.ends for planned, ours in sides for w in (*planned, *ours)])
    low, high = ends.min(axis=0), ends.max(axis=0)
    pen = Pen(np.round((low + high) / 2))
    margin = max(0.5, MARGIN * float((high - low).max()))
    (left, bottom), (right, top) = pen.local(low)[0], pen.local(high)[0]
    box = f"{left - margin:.2f} {top - margin:.2f} {right - left + 2 * margin:.2f} {bottom - top + 2 * margin:.2f}"
    return [
        _figure(data, hypothesis, planned, ours, pen, box)
        for hypothesis, (planned, ours) in zip(shown, sides, strict=True)
    ]


def _figure(
    data: ReportData, hypothesis: dict[str, Any], planned: Sequence[DrawnWall], ours: Sequence[DrawnWall],
    pen: Pen, box: str,
) -> HypothesisFigure:  # fmt: skip
    taken_s = {s for s, _ in hypothesis.get("rooms") or ()}
    taken_a = {a for _, a in hypothesis.get("rooms") or ()}
    fills = [r.polygon for r in (data.a_graph.rooms if data.a_graph else ()) if r.id in taken_a and r.polygon]
    seen_in = {w.id: w.room for w in data.s_graph.wall_surfaces}
    layers = {
        "rooms-matched": "".join(pen.polygon(np.array(polygon)) for polygon in fills),
        "bim-walls": _path(planned, pen),
        "walls-unmatched": _path([w for w in ours if seen_in[w.id] not in taken_s], pen),
        "walls-matched": _path([w for w in ours if seen_in[w.id] in taken_s], pen),
    }
    return HypothesisFigure(*hypothesis_texts(data, hypothesis), len(taken_a), box, layers)


def hypothesis_texts(data: ReportData, hypothesis: dict[str, Any]) -> tuple[str, str, str]:
    """The storey's name, the score, and the pose of the map's origin."""
    floor_id = hypothesis.get("floor")
    floor = data.floor_named(floor_id)
    storey = (floor.name or floor.id) if floor else str(floor_id or "the plan")
    yaw, x, y = hypothesis["T_a_s"]
    turn = (math.degrees(yaw) + 180) % 360 - 180
    place = f"{x:.2f}, {y:.2f} m, {turn:.1f}°"
    return storey, f"{hypothesis['score']:.1f}".replace("-", MINUS), place.replace("-", MINUS)


def _path(walls: Sequence[DrawnWall], pen: Pen) -> str:
    if not walls:
        return ""
    lines = pen.local(np.concatenate([w.ends for w in walls])).reshape(-1, 4)
    return '<path d="' + "".join(f"M{a:.2f},{b:.2f}L{c:.2f},{d:.2f}" for a, b, c, d in lines) + '"/>'
