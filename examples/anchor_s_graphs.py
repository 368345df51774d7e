"""Matches a factor graph saved by S-Graphs, which has no clouds, with a building's plan and anchors it there.

    python examples/anchor_s_graphs.py GRAPH.g2o PLAN.json

PLAN is an A-graph: a run's a_graph.json, or a file with the key `a_graph`. Prints the keyframe poses in building
coordinates, as `id x y z qx qy qz qw`; z is relative to the first keyframe, since walls do not determine the height.
"""

import sys

import gtsam
from gtsam.symbol_shorthand import B, O, P, W, X

import factors
from data import SceneGraph
from data.common.cli import run_command
from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from data.slam_output.g2o import PlaneGraph, plane_of, read_g2o
from matching import Matcher

STEP, FIXED = factors.noise_of_pose(0.01, 0.05), factors.noise_of_pose(1e-4, 1e-4)
OWN, AGAIN = factors.noise_of_plane(0.01, 0.02, None), factors.noise_of_plane(0.01, 0.02, 1.345)


def own_factors(graph: PlaneGraph) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[int, int]]:
    """Motions and planes for GTSAM, and the keyframe in whose frame each plane is: the first that saw it."""
    found, values, keeper = gtsam.NonlinearFactorGraph(), gtsam.Values(), dict[int, int]()
    for key, pose in ((O(0), gtsam.Pose3()), *((X(i), gtsam.Pose3(T)) for i, T in graph.keyframes.items())):
        values.insert(key, pose)
    for key in (O(0), X(min(graph.keyframes))):
        found.add(gtsam.PriorFactorPose3(key, values.atPose3(key), FIXED))
    for step in graph.steps:
        found.add(gtsam.BetweenFactorPose3(X(step.first), X(step.second), gtsam.Pose3(step.T_first_second), STEP))
    for seen in graph.seen:
        plane, at = P(seen.plane), X(seen.keyframe)
        if seen.plane not in keeper:
            keeper[seen.plane] = seen.keyframe
            values.insert(plane, gtsam.OrientedPlane3(seen.plane_in_sensor))
            found.add(factors.observe_own_plane(seen.plane_in_sensor, O(0), plane, OWN))
        else:
            found.add(factors.observe_plane(seen.plane_in_sensor, at, X(keeper[seen.plane]), plane, AGAIN))
    return found, values, keeper


def main() -> None:
    """Raises UserError for a damaged file and if the match is not unique."""
    if len(sys.argv) != 3:
        raise UserError("usage: python examples/anchor_s_graphs.py GRAPH.g2o PLAN.json")
    graph, plan = read_g2o(sys.argv[1]), SceneGraph.load(sys.argv[2], "a_graph")
    for line in graph.refused:
        print(f"left out, {line}", file=sys.stderr)
    s_graph = graph.scene_graph()
    match = Matcher.load().match(s_graph, plan)
    print(f"{match.status}: {match.reason}", file=sys.stderr)
    if match.status != "unique":
        raise UserError(f"the map has no unique match in {sys.argv[2]}: {match.reason}")

    whole, values, keeper = own_factors(graph)
    keys = {
        wall.id: factors.PlaneKeys(P(plane), X(keeper[plane]), W(k))
        for k, wall in enumerate(s_graph.wall_surfaces)
        if (plane := plane_of(wall.id)) in keeper
    }
    anchors = factors.anchors_of(match, plan, keys, values, B(0))
    whole.push_back(anchors.graph())
    values.insert(anchors.start)
    anchored = gtsam.LevenbergMarquardtOptimizer(whole, values).optimize()
    T_bim_map = anchored.atPose3(B(0)).inverse()
    for number in graph.keyframes:
        pose = T_bim_map.compose(anchored.atPose3(X(number))).matrix()
        print(number, *(f"{value:.6f}" for value in poses_to_xyzquat(pose)))


if __name__ == "__main__":
    run_command(main)
