"""Matches a factor graph saved by S-Graphs with a building's plan and anchors it there.

    python examples/anchor_s_graphs.py GRAPH.g2o PLAN.json

PLAN is an A-graph: a run's a_graph.json, or a file with the key `a_graph`. Prints the keyframe poses in building
coordinates, as `id x y z qx qy qz qw`.
"""

import sys

import numpy as np

from data import SceneGraph
from data.common.cli import run_command
from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from data.scene_graph.g2o import plane_of, read_g2o
from matching import Matcher
from sgslam.backend import anchor_plane_graph
from sgslam.geometry.frames import se2_to_se3


def main() -> None:
    """Raises UserError for a damaged file and if the match is not unique."""
    if len(sys.argv) != 3:
        raise UserError("usage: python examples/anchor_s_graphs.py GRAPH.g2o PLAN.json")
    graph, plan = read_g2o(sys.argv[1]), SceneGraph.load(sys.argv[2], "a_graph")
    for line in graph.refused:
        print(f"left out, {line}", file=sys.stderr)

    match = Matcher.load().match(graph.scene_graph(), plan)
    print(f"{match.status}: {match.reason}", file=sys.stderr)
    if match.status != "unique" or match.T_a_s is None:
        raise UserError(f"the map has no unique match in {sys.argv[2]}: {match.reason}")

    pairs = [(plane_of(s_id), plan.surface_by_id[a_id]) for s_id, a_id, _ in match.wall_surfaces]
    anchored = anchor_plane_graph(graph, pairs, se2_to_se3(*match.T_a_s))

    planes_before = {plane: se2_to_se3(*match.T_a_s) for plane in graph.planes}
    off = [
        (abs(np.linalg.inv(planes_before[p]).T @ graph.planes[p] @ [*wall.centroid, 0, 1]),
         abs(anchored.planes[p] @ [*wall.centroid, 0, 1]))
        for p, wall in pairs
    ]  # fmt: skip
    before, after = 1000 * np.median(off, axis=0)
    print(f"median distance of walls from the plan: {before:.0f} mm matched, {after:.0f} mm anchored", file=sys.stderr)
    for number, pose in anchored.keyframes.items():
        print(number, *(f"{value:.6f}" for value in poses_to_xyzquat(pose)))


if __name__ == "__main__":
    run_command(main)
