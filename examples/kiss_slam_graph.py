"""Anchors the local maps of KISS-SLAM to a plan.

    python examples/kiss_slam_graph.py [RESULTS PLAN.json]

RESULTS is what kiss_slam_pipeline (0.0.2) writes: `local_maps/local_map_graph.g2o` has a vertex where each local map
begins, `local_maps/plys/000000.ply`, ... its points in the frame of the whole map. Indoors split the local maps every
3 m (`local_mapper.splitting_distance`) with voxels of 0.1 m. The sensor must begin level. PLAN is an A-graph. Prints
the vertices in building coordinates. Without arguments, makes its own input and prints the error too.
"""

import sys
import tempfile
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, P, W
from made_input import HEIGHT, Array, error, wall_in_map, write_local_maps
from walls_in_cloud import walls_around

import factors
from data import SceneGraph
from data.common.cli import run_command
from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from data.scans.formats import read_points
from matching import Matcher

OWN = factors.noise_of_plane(0.01, 0.02, None)
STEP = factors.noise_of_pose(0.02, 0.1, 1.345)  # KISS-SLAM gives all edges the identity as information


def placed(results: Path, plan: SceneGraph) -> tuple[list[gtsam.Pose3], list[gtsam.Pose3]]:
    """T_bim_vertex of all vertices, by the match alone and anchored. Raises UserError if the match is not unique."""
    edges, values = gtsam.readG2o(str(results / "local_maps/local_map_graph.g2o"), True)
    graph, keys, walls, vertices = gtsam.NonlinearFactorGraph(), dict[str, factors.PlaneKeys](), [], list(values.keys())
    for edge in (edges.at(n) for n in range(edges.size())):
        if isinstance(edge, gtsam.BetweenFactorPose3):
            first, second = edge.keys()
            graph.add(gtsam.BetweenFactorPose3(first, second, edge.measured(), STEP))
    values.insert(O(0), gtsam.Pose3())
    for key in (vertices[0], O(0)):
        graph.add(gtsam.PriorFactorPose3(key, values.atPose3(key), factors.noise_of_pose(1e-4, 1e-4)))
    for path in sorted((results / "local_maps/plys").glob("*.ply")):
        vertex = int(path.stem)
        points: Array = values.atPose3(vertex).transformTo(read_points(path).astype(float).T).T
        for seen in walls_around(points, path.stem):
            keys[seen.wall] = own = factors.PlaneKeys(P(len(keys)), vertex, W(len(keys)))
            graph.add(factors.observe_own_plane(seen.plane, O(0), own.plane, OWN))
            values.insert(own.plane, gtsam.OrientedPlane3(seen.plane))
            walls.append(wall_in_map(seen, values.atPose3(vertex)))
    match = Matcher.load().match(SceneGraph("map", (), tuple(walls)), plan)
    print(f"{match.status}: {match.reason}", file=sys.stderr)
    if match.status != "unique":
        raise UserError(f"{results}: its walls have no unique place in the plan: {match.reason}")
    anchors = factors.anchors_of(match, plan, keys, values, B(0), height=HEIGHT)
    graph.push_back(anchors.graph())
    values.insert(anchors.start)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    matched, anchored = (
        [found.atPose3(B(0)).inverse().compose(found.atPose3(vertex)) for vertex in vertices]
        for found in (values, result)
    )
    return matched, anchored


def main() -> None:
    """Raises UserError for unreadable input and if the match is not unique."""
    if len(sys.argv) not in (1, 3):
        raise UserError("usage: python examples/kiss_slam_graph.py [RESULTS PLAN.json]")
    with tempfile.TemporaryDirectory() as made:
        results, truth = Path(made), None
        if len(sys.argv) == 3:
            results, plan = Path(sys.argv[1]), SceneGraph.load(sys.argv[2], "a_graph")
        else:
            plan, truth = write_local_maps(results)
        matched, anchored = placed(results, plan)
    for vertex, pose in enumerate(anchored):
        print(vertex, *(f"{value:.6f}" for value in poses_to_xyzquat(np.asarray(pose.matrix()))))
    if truth is not None:
        for name, poses in (("matched", matched), ("anchored", anchored)):  # the last vertex has no cloud
            print(f"error of the local maps, {name}: {error(poses[:-1], truth[:-1]):.3f} m", file=sys.stderr)


if __name__ == "__main__":
    run_command(main)
