"""Quality of a map: an S-graph's walls and rooms against the plan, under the true T_bim_map. Pure functions.

The map's pose is given and not fitted: a map that is correct but misplaced scores badly.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from data.geometry import se2
from data.geometry.areas import overlap, united
from data.geometry.intervals import united as united_intervals
from evaluation.metrics.statistics import Score, Statistics
from evaluation.metrics.surface_overlap import Overlaps, one_storey, plan_motion
from evaluation.metrics.true_matches import best_surfaces, overlaps_in_plan, representatives, room_area, true_matches

Array = NDArray[np.float64]
LEAST_COVER = 0.5  # share of a surface's length for it to be found (A) or true (S)
LEAST_IOU = 0.5


@dataclass(frozen=True, eq=False)
class WallScores:
    """The score of wall surfaces: `score` counts surfaces.

    `pairs` (K) are (S id, A id) of corresponding surfaces; `offset_m` (K,) is the distance along the plan's inward
    normal, `angle_rad` (K,) the rotation against the plan; `offset_mm` and `angle_deg` are their statistics,
    None without pairs.
    """

    score: Score
    missed: tuple[str, ...]
    false: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    offset_m: Array
    angle_rad: Array
    offset_mm: Statistics | None
    angle_deg: Statistics | None


@dataclass(frozen=True)
class RoomScores:
    """The score of rooms. `pairs` are (S id, A id), for each A room the S room that represents it; `centroid_m` and
    `iou` belong to them. An IoU is None if a polygon is missing; `centroid` is None without pairs."""

    score: Score
    missed: tuple[str, ...]
    false: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    centroid_m: tuple[float, ...]
    iou: tuple[float | None, ...]
    centroid: Statistics | None


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
    offset, angle = lying.offset[i, chosen[i]], lying.angle[i, chosen[i]]
    return WallScores(
        Score(int(true.sum()), len(true), int((found & counts).sum()), int(counts.sum())),
        tuple(lying.a.ids[j] for j in np.flatnonzero(~found & counts)),
        tuple(lying.s.ids[k] for k in np.flatnonzero(~true)),
        tuple((lying.s.ids[k], lying.a.ids[chosen[k]]) for k in i), offset, angle,
        Statistics.of(1000 * offset) if len(i) else None, Statistics.of(np.degrees(angle)) if len(i) else None,
    )  # fmt: skip


def room_scores(
    s_graph: SceneGraph, a_graph: SceneGraph, T_bim_map: Array, visible: Collection[str] | None = None
) -> RoomScores:
    """Precision, recall and errors of the rooms.

    An A room is found if the S room that represents it (`true_matches`, the larger of two parts) has an intersection
    over union of at least 0.5 with it; if a polygon is missing, the true match suffices. These S rooms are true, the
    others are not. The centroid error is between the centroids in the graphs. Raises as `wall_scores` does.
    """
    _known(visible, a_graph.room_by_id, "room")
    truth = true_matches(s_graph, a_graph, T_bim_map)
    bearing = representatives(truth, s_graph)[0]
    T_a_s = np.array(truth.T_a_s)
    pairs = tuple((r.id, truth.rooms[r.id]) for r in s_graph.rooms if r.id in bearing)
    ious = tuple(_iou(s_graph, a_graph, pair, T_a_s) for pair in pairs)
    right = [pair for pair, iou in zip(pairs, ious, strict=True) if iou is None or iou >= LEAST_IOU]
    true, found = {s for s, _ in right}, {a for _, a in right}
    expected = [r.id for r in a_graph.rooms if visible is None or r.id in visible]
    errors = [
        se2.apply(T_a_s, np.array(s_graph.room_by_id[s].centroid)) - a_graph.room_by_id[a].centroid for s, a in pairs
    ]
    apart = [float(np.hypot(*error)) for error in errors]
    return RoomScores(
        Score(len(right), len(s_graph.rooms), len(found.intersection(expected)), len(expected)),
        tuple(key for key in expected if key not in found), tuple(r.id for r in s_graph.rooms if r.id not in true),
        pairs, tuple(apart), ious, Statistics.of(np.array(apart)) if apart else None,
    )  # fmt: skip


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
