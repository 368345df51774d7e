"""Matches your own pose graph with planes to a plan, and anchors it there: from S-graph to optimum.

python examples/own_pose_graph.py
"""

import gtsam
from gtsam.symbol_shorthand import B, O, P, W, X
from made_input import HEIGHT, Walk, error, walk_through_a_flat, wall_in_map

import factors
from data import SceneGraph
from matching import Matcher

STEP, OWN = factors.noise_of_pose(0.01, 0.06), factors.noise_of_plane(0.005, 0.01, None)
AGAIN, FIXED = factors.noise_of_plane(0.005, 0.01, 1.345), factors.noise_of_pose(1e-4, 1e-4)
Keys = dict[str, factors.PlaneKeys]


def own_factors(walk: Walk, i: int, pose: gtsam.Pose3, keys: Keys) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Your graph: odometry to pose i, and the planes seen there; a plane is kept in the frame of the pose that saw it
    first."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(X(i), pose)
    if i:
        graph.add(gtsam.BetweenFactorPose3(X(i - 1), X(i), walk.steps[i - 1], STEP))
    else:
        values.insert(O(0), gtsam.Pose3())
        for key in (O(0), X(0)):
            graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(), FIXED))
    for seen in walk.seen[i]:
        if seen.wall in keys:
            graph.add(factors.observe_plane(seen.plane, X(i), keys[seen.wall].anchor, keys[seen.wall].plane, AGAIN))
            continue
        keys[seen.wall] = factors.PlaneKeys(P(len(keys)), X(i), W(len(keys)))
        graph.add(factors.observe_own_plane(seen.plane, O(0), keys[seen.wall].plane, OWN))
        values.insert(keys[seen.wall].plane, gtsam.OrientedPlane3(seen.plane))
    return graph, values


def s_graph(walk: Walk, keys: Keys, values: gtsam.Values) -> SceneGraph:
    """Your map as a matcher takes it: all walls seen so far, in the map frame; rooms are not needed."""
    first = {s.wall: s for sightings in reversed(walk.seen) for s in sightings}
    return SceneGraph("map", (), tuple(wall_in_map(first[w], values.atPose3(own.anchor)) for w, own in keys.items()))


def main() -> None:
    """Prints the error of the poses by the match alone, and anchored."""
    walk, keys, pose = walk_through_a_flat(), Keys(), gtsam.Pose3()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i in range(len(walk.truth)):
        pose = pose.compose(walk.steps[i - 1]) if i else pose
        more, start = own_factors(walk, i, pose, keys)
        graph.push_back(more)
        values.insert(start)
    values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    match = Matcher.load().match(s_graph(walk, keys, values), walk.plan)
    print(f"{match.status}: {match.reason}")
    anchors = factors.anchors_of(match, walk.plan, keys, values, B(0), height=HEIGHT)
    graph.push_back(anchors.graph())
    values.insert(anchors.start)
    anchored = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    for name, found in (("matched", values), ("anchored", anchored)):
        poses = [found.atPose3(B(0)).inverse().compose(found.atPose3(X(i))) for i in range(len(walk.truth))]
        print(f"error of the poses, {name}: {error(poses, walk.truth):.3f} m")


if __name__ == "__main__":
    main()
