"""Leave-one-out test of anchoring: distance of each wall from the plan when it has no anchor itself.

A factor graph that S-Graphs saved is matched with the building's A-graph and anchored without one of its walls, for
each wall in turn. The wall's distance from the plan is measured at the planned wall's centre: with the map placed
rigidly by the match, rigidly by the best fit of all other walls, and anchored to them.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.scene_graph import SceneGraph, WallSurface
from data.scene_graph.g2o import PlaneGraph, PlaneSeen, plane_of, read_g2o
from evaluation.harness import Case, Options, Record, Study
from evaluation.harness.tables import grouped
from matching import Matcher
from sgslam.backend import anchor_plane_graph
from sgslam.geometry.frames import se2_to_se3, transform_planes

SLAM_GRAPHS = "../shared/data/slam_graphs"
PLACED = {"matched_m": "placed by the match (mm)", "rigid_m": "rigid, best fit (mm)", "anchored_m": "anchored (mm)"}
Pairs = list[tuple[int, WallSurface]]


class Choice(Options):
    """The factor graph (.g2o), the plan (JSON of an A-graph, or with the key `a_graph`), and the matching methods."""

    graph: str = f"{SLAM_GRAPHS}/SE2_s_graph.g2o"
    plan: str = f"{SLAM_GRAPHS}/SE2.json"
    methods: tuple[str, ...] = ("learned",)


class Map(Case):
    """A factor graph, the building's plan, and the method that matches them."""

    graph: str
    plan: str
    method: str

    def files(self) -> set[str]:
        """The factor graph and the plan."""
        return {self.graph, self.plan}


class LeftOut(BaseModel):
    """One wall of the plan and its planes; distances (m) from the plan are means over its planned surfaces."""

    model_config = ConfigDict(frozen=True)

    wall: str
    planes: tuple[int, ...]
    matched_m: float
    rigid_m: float
    anchored_m: float


class Distances(Record):
    """All matched walls."""

    walls: tuple[LeftOut, ...]


def cases(options: Choice) -> list[Map]:
    """The map with each method."""
    return [Map(graph=options.graph, plan=options.plan, method=method) for method in options.methods]


def measure(case: Map, work: Path) -> Distances:
    """Leaves out every matched wall in turn. Raises UserError as `one_wall_out` does."""
    graph, plan = read_g2o(Path(case.graph)), SceneGraph.load(Path(case.plan), "a_graph")
    return Distances(walls=one_wall_out(graph, plan, case.method))


def one_wall_out(graph: PlaneGraph, a: SceneGraph, method: str) -> tuple[LeftOut, ...]:
    """Leaves out every matched wall in turn. Raises UserError if the map, with or without a wall, has no unique
    match."""
    s, matcher = graph.scene_graph(), Matcher.load(method)
    found = []
    for mine in _walls(_unique(matcher, s, a, "the graph")[0]):
        planes = {plane for plane, _ in mine}
        rest = replace(s, wall_surfaces=tuple(w for w in s.wall_surfaces if plane_of(w.id) not in planes))
        others, T_bim_map = _unique(matcher, rest, a, f"without wall {_name(mine[0][1])} the graph")
        matched = {plane: transform_planes(T_bim_map, graph.planes[plane]) for plane in planes}
        rigid, anchored = (anchor_plane_graph(g, others, T_bim_map).planes for g in (_stiff(graph), graph))
        off = dict(zip(PLACED, (_off(mine, placed) for placed in (matched, rigid, anchored)), strict=True))
        names = sorted({_name(surface) for _, surface in mine})
        found.append(LeftOut(wall=" ".join(names), planes=tuple(sorted(planes)), **off))
    return tuple(found)


def _unique(matcher: Matcher, s: SceneGraph, a: SceneGraph, what: str) -> tuple[Pairs, NDArray[np.float64]]:
    """The planes with their planned surfaces, and T_bim_map (4, 4)."""
    match = matcher.match(s, a)
    if match.status != "unique" or match.T_a_s is None:
        raise UserError(f"{what} is not matched uniquely: {match.reason}")
    return [(plane_of(s_id), a.surface_by_id[a_id]) for s_id, a_id, _ in match.wall_surfaces], se2_to_se3(*match.T_a_s)


def _stiff(graph: PlaneGraph) -> PlaneGraph:
    """The same map as a rigid body: all planes observed from one keyframe without error."""
    sure = np.diag([1e10] * 3)
    seen = tuple(PlaneSeen(0, number, plane, sure) for number, plane in graph.planes.items())
    return replace(graph, keyframes={0: np.eye(4)}, steps=(), seen=seen, same=())


def _walls(pairs: Pairs) -> list[Pairs]:
    """The pairs grouped by wall: pairs with a common plane of the map or a common wall of the plan."""
    walls: list[Pairs] = []
    for pair in pairs:
        mine = [w for w in walls if any(plane == pair[0] or _name(planned) == _name(pair[1]) for plane, planned in w)]
        walls = [w for w in walls if w not in mine] + [[p for w in mine for p in w] + [pair]]
    return walls


def _name(surface: WallSurface) -> str:
    """The name of a surface's wall."""
    return surface.source or surface.id.partition("@")[0]


def _off(pairs: Pairs, planes_in_bim: dict[int, NDArray[np.float64]]) -> float:
    points = [np.array([*surface.centroid, 0.0, 1.0]) for _, surface in pairs]
    return float(np.mean([abs(planes_in_bim[plane] @ x) for (plane, _), x in zip(pairs, points, strict=True)]))


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each wall, and the medians of each method."""

    def cells(own: pd.DataFrame) -> dict[str, str]:
        planes = " ".join(str(plane) for plane in own.planes.iloc[0]) if len(own) == 1 else ""
        return {"planes of the map": planes} | {
            title: f"{1000 * own[name].median():.1f}" for name, title in PLACED.items()
        }

    lines = _lines(rows)
    every = lines.assign(wall="**median**")
    table = pd.concat([grouped(part, ("method", "wall"), cells) for part in (lines, every)])
    return {"walls": table.rename(columns={"wall": "wall of the plan"})}


def _lines(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each wall."""
    return pd.DataFrame([{"method": row.method, **wall} for row in rows.itertuples() for wall in row.walls])


STUDY = Study(
    "one_wall_out", "how far a wall without an anchor is from the plan, in a published system's map that is anchored",
    Choice, Choice(), Map, Distances, cases, measure, tables,
)  # fmt: skip
