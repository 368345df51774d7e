"""Anchors in iSAM2: they come as the map grows and is matched, and go where a wall is not as planned.

python examples/isam2_anchors.py
"""

from dataclasses import replace

import gtsam
from gtsam.symbol_shorthand import B, X
from made_input import HEIGHT, error, walk_through_a_flat
from own_pose_graph import Keys, own_factors, s_graph

import factors
from matching import Matcher

EVERY, FARTHEST = 5, 0.1  # poses between two matches; m between a wall and its plan


def main() -> None:
    """Prints the anchors at each match, and the error at the end."""
    walk, keys, matcher = walk_through_a_flat(built_off=0.2), Keys(), Matcher.load()  # a wall stands 20 cm off the plan
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")  # the height is known much worse than x and y
    isam, pose = gtsam.ISAM2(parameters), gtsam.Pose3()
    held = dict[str, tuple[str, gtsam.NoiseModelFactor, list[int]]]()  # planned wall, anchor, indices of both factors
    let_go = set[str]()
    for i in range(len(walk.truth)):
        isam.update(*own_factors(walk, i, pose, keys))
        now = isam.calculateEstimate()
        pose = now.atPose3(X(i)).compose(walk.steps[i]) if i < len(walk.steps) else pose
        if i % EVERY and i < len(walk.steps):
            continue
        match = matcher.match(s_graph(walk, keys, now), walk.plan)
        if match.status != "unique":
            continue
        pairs = {s_id: a_id for s_id, a_id, _ in match.wall_surfaces}
        off = {wall for wall, (_, anchor, _) in held.items() if abs(anchor.unwhitenedError(now)[2]) > FARTHEST}
        gone = off | {wall for wall, (planned, _, _) in held.items() if pairs.get(wall) != planned}
        isam.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), [n for wall in gone for n in held.pop(wall)[2]])
        let_go |= off
        new = tuple(pair for pair in match.wall_surfaces if pair[0] not in {*held, *let_go})
        if new:
            values, fresh = isam.calculateEstimate(), replace(match, wall_surfaces=new)
            anchors = factors.anchors_of(fresh, walk.plan, keys, values, B(0), height=HEIGHT)
            indices = list(isam.update(anchors.graph(), anchors.start).getNewFactorsIndices())[-2 * len(new) :]
            for k, (wall, (_, anchor)) in enumerate(anchors.walls.items()):  # a frame and an anchor each
                held[wall] = pairs[wall], anchor, indices[2 * k : 2 * k + 2]
        print(f"pose {i}: {len(held)} anchors, {len(gone)} let go")
    values = isam.calculateEstimate()
    poses = [values.atPose3(B(0)).inverse().compose(values.atPose3(X(i))) for i in range(len(walk.truth))]
    print(f"error of the poses: {error(poses, walk.truth):.3f} m; not as planned: {', '.join(sorted(let_go))}")


if __name__ == "__main__":
    main()
