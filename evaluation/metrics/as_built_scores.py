"""Scores of a run's reported deviations against the true changes of the walls."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data.scene_graph import SceneGraph
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_walls import TrueWall

Array = NDArray[np.float64]
KINDS = {"moved": "moved", "absent": "absent", "extra": "unplanned"}  # reported kind: true kind
LEAST_VIEWS = 3
_ON_WALL = 0.1  # m
_ENOUGH = 1.0  # m of overlap that suffice for a long surface


@dataclass(frozen=True)
class DeviationScore:
    """The score of one kind of deviation, counted in IFC walls (reports of extra walls: in wall surfaces).

    The walls to find are those that at least three keyframes see. `offset_errors` (m) are those of the moved walls that
    were found. `missed` and `false` are ids.
    """

    score: Score
    offset_errors: tuple[float, ...]
    missed: tuple[str, ...]
    false: tuple[str, ...]


def deviation_scores(
    deviations: Sequence[Mapping[str, Any]], s_graph: SceneGraph, a_graph: SceneGraph, T_bim_map: Array | None,
    walls: list[TrueWall],
) -> dict[str, DeviationScore]:  # fmt: skip
    """The scores of the significant entries of deviations.json, by kind (`moved`, `absent`, `extra`).

    `a_graph` is the plan's; `T_bim_map` (4, 4) is None if the run is not anchored.
    """
    significant = [d for d in deviations if d["significant"]]
    result = {}
    for kind, is_kind in KINDS.items():
        own = [d for d in significant if d["kind"] == kind]
        there = {wall.id: wall for wall in walls if wall.kind == is_kind}
        expected = {key for key, wall in there.items() if wall.views >= LEAST_VIEWS}
        if kind == "extra":
            lies_on = {d["s_id"]: _wall_under(s_graph, d["s_id"], T_bim_map, there) for d in own}
            found, false = set(lies_on.values()) - {None}, [s for s, wall in lies_on.items() if wall is None]
            answered = len(lies_on)
        else:
            reported = {d["source"] for d in own}
            found, false, answered = reported & there.keys(), sorted(reported - there.keys()), len(reported)
        score = Score(answered - len(false), answered, len(found & expected), len(expected))
        errors = tuple(_offset_errors(own, a_graph, there)) if kind == "moved" else ()
        result[kind] = DeviationScore(score, errors, tuple(sorted(expected - found)), tuple(false))
    return result


def _offset_errors(
    moved: Sequence[Mapping[str, Any]], a_graph: SceneGraph, there: dict[str, TrueWall]
) -> Iterator[float]:
    """For each wall that was correctly reported, the median offset error (m) over its surfaces."""
    by_wall = defaultdict(list)
    for d in moved:
        if d["source"] in there:
            true = np.array(there[d["source"]].offset_in_bim) @ a_graph.surface_by_id[d["a_id"]].normal
            by_wall[d["source"]].append(abs(d["offset_m"] - true))
    for errors in by_wall.values():
        yield float(np.median(errors))


def _wall_under(s_graph: SceneGraph, s_id: str, T_bim_map: Array | None, there: dict[str, TrueWall]) -> str | None:
    """The wall on whose faces half of a map surface, or a metre of it, lies; None if there is none."""
    assert T_bim_map is not None  # a run that is not anchored reports nothing
    ends = np.array(s_graph.surface_by_id[s_id].ends())
    line = shapely.LineString(ends @ T_bim_map[:2, :2].T + T_bim_map[:2, 3])
    on = {key: _near(wall).intersection(line).length for key, wall in there.items()}
    best = max(on, key=on.__getitem__, default=None)
    return best if best is not None and on[best] > min(0.5 * line.length, _ENOUGH) else None


def _near(wall: TrueWall) -> Any:
    return shapely.Polygon(wall.footprint).buffer(_ON_WALL)
