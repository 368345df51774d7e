"""Anchors your own pose graph to a plan with the package `factors`: observed wall planes tied to planned walls.

    python examples/own_pose_graph.py
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, P, X

import factors

WALLS = np.array([[1, 0, 0, 0], [-1, 0, 0, 8], [0, 1, 0, 0], [0, -1, 0, 6]], dtype=float)  # of the plan: n.x + d = 0
T_BIM_START = gtsam.Pose3(gtsam.Rot3.Yaw(0.4), [1.0, 2.0, 1.0])  # the robot's start, unknown to the graph
STEP = gtsam.Pose3(gtsam.Rot3.Yaw(0.05), [0.3, 0.0, 0.0])
SLIP = gtsam.Pose3(gtsam.Rot3.Yaw(0.01), [0.02, 0.0, 0.0])  # odometry error of each step

graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
tight, loose = factors.noise_of_pose(1e-4, 1e-4), factors.noise_of_pose(1.0, 100.0)
seen, as_built = factors.noise_of_plane(0.005, 0.01, 1.345), factors.noise_of_plane(0.01, 0.02, 1.345)
for key in (O(0), X(0)):  # your graph: the first pose and the odometry
    graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(), tight))
    values.insert(key, gtsam.Pose3())
truth = [T_BIM_START]
for i in range(1, 12):
    truth.append(truth[-1].compose(STEP))
    graph.add(gtsam.BetweenFactorPose3(X(i - 1), X(i), STEP.compose(SLIP), factors.noise_of_pose(0.02, 0.05)))
    values.insert(X(i), values.atPose3(X(i - 1)).compose(STEP.compose(SLIP)))
for j, wall in enumerate(WALLS):  # each wall as the keyframes observe it; its variable is in the first one's frame
    own = truth[0].matrix().T @ wall
    graph.add(factors.observe_own_plane(own, O(0), P(j), factors.noise_of_plane(0.005, 0.01, None)))
    values.insert(P(j), gtsam.OrientedPlane3(own))
    for i in range(1, 12):
        graph.add(factors.observe_plane(truth[i].matrix().T @ wall, X(i), X(0), P(j), seen))
    graph.add(factors.anchor_plane(wall, B(0), X(0), P(j), as_built))  # the planned wall, once it is matched
values.insert(B(0), gtsam.Pose3(gtsam.Rot3.Yaw(-0.3), [-1.5, -1.5, -1.0]))  # T_map_bim: a rough guess suffices
graph.add(gtsam.PriorFactorPose3(B(0), values.atPose3(B(0)), loose))  # walls do not constrain the height
result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
T_bim_last = result.atPose3(B(0)).inverse().compose(result.atPose3(X(11)))
print(f"error of the last keyframe: {np.hypot(*(T_bim_last.translation() - truth[-1].translation())[:2]):.4f} m")
