"""Quality of a map: an S-graph's walls and rooms against the plan, under the true T_bim_map. Pure functions.

The map's pose is given and not fitted: a map that is correct but misplaced scores badly.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from data.geometry.areas import overlap, united
from data.geometry.intervals import united as united_intervals
from evaluation.metrics.statistics import Score, Statistics
from evaluation.metrics.surface_overlap import Overlaps, one_storey, plan_motion
from evaluation.metrics.true_matches import best_surfaces, overlaps_in_plan, representatives, room_area, true_matches

Array = NDArray[np.float64]
LEAST_COVER = 0.5  # share of a surface's length for it to be found (A) or true (S)
LEAST_IOU = 0.5


@dataclass(frozen=True)
class WallScores:
    """The score of wall surfaces, and the magnitudes (mm) of their offsets along the plan's inward normals; None where
    no surface corresponds to a planned one."""

    score: Score
    offset_mm: Statistics | None


def wall_scores(
    s_graph: SceneGraph, a_graph: SceneGraph, T_bim_map: Array, visible: Collection[str] | None = None
) -> WallScores:
    """Precision, recall and errors of the wall surfaces.

    An A surface is found if S surfaces within the limits cover half of it, in one or several pieces; it counts if its
    id is in `visible` (default: all). An S surface is true if half of it lies on A surfaces within the limits, visible
    or not. Raises UserError for a plan with several storeys, unknown ids, and a matrix that is not a rigid motion.
    """
    _known(visible, a_graph.surface_by_id, "wall surface")
    lying = overlaps_in_plan(s_graph, one_storey(a_graph), plan_motion(T_bim_map))
    a_length, s_length = 2 * lying.a.half, 2 * lying.s.half
    counts = np.array([visible is None or key in visible for key in lying.a.ids], dtype=bool)
    covered = np.array([_covered(lying, j) for j in range(len(a_length))])
    on_plan = np.array([_on_plan(lying, i) for i in range(len(s_length))])
    found, true = covered >= LEAST_COVER * a_length, on_plan >= LEAST_COVER * s_length
    chosen = best_surfaces(lying)
    i = np.flatnonzero(chosen >= 0)
    offset = lying.offset[i, chosen[i]]
    score = Score(int(true.sum()), len(true), int((found & counts).sum()), int(counts.sum()))
    return WallScores(score, Statistics.of(1000 * offset) if len(i) else None)


def room_scores(
    s_graph: SceneGraph, a_graph: SceneGraph, T_bim_map: Array, visible: Collection[str] | None = None
) -> Score:
    """Precision and recall of the rooms.

    An A room is found if the S room that represents it (`true_matches`, the larger of two parts) has an intersection
    over union of at least 0.5 with it; if a polygon is missing, the true match suffices. These S rooms are true, the
    others are not. Raises as `wall_scores` does.
    """
    _known(visible, a_graph.room_by_id, "room")
    truth = true_matches(s_graph, a_graph, T_bim_map)
    T_a_s, found = np.array(truth.T_a_s), set[str]()
    for s_id in representatives(truth, s_graph)[0]:
        iou = _iou(s_graph, a_graph, (s_id, truth.rooms[s_id]), T_a_s)
        if iou is None or iou >= LEAST_IOU:
            found.add(truth.rooms[s_id])
    expected = [r.id for r in a_graph.rooms if visible is None or r.id in visible]
    return Score(len(found), len(s_graph.rooms), len(found.intersection(expected)), len(expected))


def _known(visible: Collection[str] | None, ids: Collection[str], what: str) -> None:
    if unknown := sorted(set(visible or ()) - set(ids)):
        raise UserError(f"visible: no {what} '{unknown[0]}' in the plan ({len(unknown)} such ids)")


def _covered(lying: Overlaps, j: int) -> float:
    """The length (m) of an A surface that is covered by S surfaces."""
    i = np.flatnonzero(lying.length[:, j])
    return sum(b - a for a, b in united_intervals(list(zip(lying.low[i, j], lying.high[i, j], strict=True))))


def _on_plan(lying: Overlaps, i: int) -> float:
    """The length (m) of an S surface that lies on A surfaces."""
    parts = []
    for j in np.flatnonzero(lying.length[i]):
        # From the A surface's tangent to the S surface's own, both from the S surface's middle.
        along = float((lying.s.centre[i] - lying.a.centre[j]) @ lying.a.tangent[j])
        cosine = float(np.cos(lying.angle[i, j]))
        parts.append(((lying.low[i, j] - along) / cosine, (lying.high[i, j] - along) / cosine))
    return sum(b - a for a, b in united_intervals(parts))


def _iou(s_graph: SceneGraph, a_graph: SceneGraph, pair: tuple[str, str], T_a_s: Array) -> float | None:
    s = room_area(s_graph.room_by_id[pair[0]], T_a_s)
    a = room_area(a_graph.room_by_id[pair[1]], np.zeros(3))
    return None if s is None or a is None else float(overlap(s, a).area / united([s, a]).area)
