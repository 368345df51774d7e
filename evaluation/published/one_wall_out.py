"""Leave-one-out test of anchoring: distance of each wall from the plan when it has no anchor itself.

    python -m evaluation.published.one_wall_out GRAPH.g2o PLAN.json

GRAPH is a factor graph of S-Graphs, PLAN the building's A-graph (or JSON with the key `a_graph`). For each wall, the
graph is matched and anchored without it. Then the wall's distance from the plan is measured at the planned wall's
centre: with the map placed rigidly by the match, rigidly by the best fit of all other walls, and anchored to them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.scene_graph import SceneGraph, WallSurface
from data.scene_graph.g2o import PlaneGraph, PlaneSeen, plane_of, read_g2o
from matching import Matcher
from sgslam.backend import anchor_plane_graph
from sgslam.geometry.frames import se2_to_se3, transform_planes

Pairs = list[tuple[int, WallSurface]]


@dataclass(frozen=True)
class LeftOut:
    """One wall of the plan and its planes; distances (m) from the plan are means over its planned surfaces."""

    wall: str
    planes: tuple[int, ...]
    laid: float
    rigid: float
    anchored: float


def one_wall_out(graph: PlaneGraph, a: SceneGraph, method: str = "learned") -> list[LeftOut]:
    """Leaves out every matched wall in turn. Raises UserError if the map, with or without a wall, has no unique
    match."""
    s, matcher = graph.scene_graph(), Matcher.load(method)
    matched = matcher.match(s, a)
    if matched.status != "unique":
        raise UserError(f"the graph is not matched uniquely: {matched.reason}")
    pairs = [(plane_of(s_id), a.surface_by_id[a_id]) for s_id, a_id, _ in matched.wall_surfaces]
    found = []
    for mine in _walls(pairs):
        planes = {plane for plane, _ in mine}
        rest = replace(s, wall_surfaces=tuple(w for w in s.wall_surfaces if plane_of(w.id) not in planes))
        match = matcher.match(rest, a)
        if match.status != "unique" or match.T_a_s is None:
            raise UserError(f"without wall {_name(mine[0][1])} the graph is not matched uniquely: {match.reason}")
        T_bim_map = se2_to_se3(*match.T_a_s)
        others = [(plane_of(s_id), a.surface_by_id[a_id]) for s_id, a_id, _ in match.wall_surfaces]
        laid = {plane: transform_planes(T_bim_map, graph.planes[plane]) for plane in planes}
        rigid, anchored = (anchor_plane_graph(g, others, T_bim_map).planes for g in (_stiff(graph), graph))
        names = sorted({_name(surface) for _, surface in mine})
        found.append(LeftOut(" ".join(names), tuple(sorted(planes)), *(_off(mine, p) for p in (laid, rigid, anchored))))
    return found


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


def _off(pairs: Pairs, planes_in_bim: dict[int, np.ndarray]) -> float:
    points = [np.array([*surface.centroid, 0.0, 1.0]) for _, surface in pairs]
    return float(np.mean([abs(planes_in_bim[plane] @ x) for (plane, _), x in zip(pairs, points, strict=True)]))


def table(found: list[LeftOut]) -> str:
    """Markdown table: a line for each wall, and the medians."""
    head = ("wall of the plan", "planes of the map", "laid by the match (mm)", "rigid, best fit (mm)", "anchored (mm)")
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    off = np.array([(f.laid, f.rigid, f.anchored) for f in found])
    for row in (*found, LeftOut("**median**", (), *np.median(off, axis=0).tolist())):
        millimetres = " | ".join(f"{1000 * metres:.1f}" for metres in (row.laid, row.rigid, row.anchored))
        lines.append(f"| {row.wall} | {' '.join(map(str, row.planes))} | {millimetres} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.published.one_wall_out", description="Measure anchoring with each wall left out."
    )
    parser.add_argument("graph", type=Path, metavar="GRAPH.g2o", help="a factor graph that S-Graphs saved")
    parser.add_argument("plan", type=Path, metavar="PLAN.json", help="the building's A-graph")
    parser.add_argument("--method", default="learned", metavar="NAME", help="matching method (default learned)")
    parser.add_argument("--benchmarks", type=Path, metavar="FILE", help="page of results; its section is written")
    options = parser.parse_args()
    text = table(one_wall_out(read_g2o(options.graph), SceneGraph.load(options.plan, "a_graph"), options.method))
    if options.benchmarks is not None:
        from evaluation.harness.benchmark_page import made_by, write_section

        command = (
            f"python -m evaluation.published.one_wall_out {options.graph} {options.plan} --method {options.method}"
        )
        write_section(options.benchmarks, "one-wall-out", f"{HEAD}\n\n{text}\nBy {made_by(command)}.")
    print(text, end="")
    return 0


HEAD = (
    "### A published system's map, anchored: leave-one-out\n\n"
    "Distance of a wall without an anchor from the plan: with the map placed rigidly by the match of all other walls, "
    "by their best fit (six degrees of freedom, the same robust losses), and with the map anchored to them. Planes of "
    "one wall are left out together."
)

if __name__ == "__main__":
    run_command(main)
