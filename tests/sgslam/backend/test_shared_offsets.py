"""A wall that was built elsewhere takes all its faces along: then they tell as much as one."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, P, R, W, X

import factors
from sgslam.backend.covariances import shared_offsets
from sgslam.mapping import PlannedWall

SIGMA = 0.012  # m


def anchored(offsets: list[list[float]]) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[int, PlannedWall]]:
    """Walls along x with any number of faces, in turns to either side; each offset (m) is along x."""
    graph, values, planned = gtsam.NonlinearFactorGraph(), gtsam.Values(), dict[int, PlannedWall]()
    noise = factors.redescending_noise_of_plane(0.004, SIGMA, 3.0)
    values.insert(X(0), gtsam.Pose3())
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), factors.noise_of_pose(0.1, 0.1)))
    each = ((wall, face, offset) for wall, faces in enumerate(offsets) for face, offset in enumerate(faces))
    for number, (wall, face, offset) in enumerate(each):
        side = 1.0 if face % 2 == 0 else -1.0
        plane = np.array([side, 0.0, 0.0, -3.0 * side * wall])
        graph.add(factors.anchor_plane(plane, W(number), X(0), P(number), noise))
        values.insert(W(number), gtsam.Pose3())
        values.insert(P(number), gtsam.OrientedPlane3(*plane[:3], plane[3] - side * offset))
        planned[W(number)] = PlannedWall(plane, np.zeros(3), f"face-{number}", wall=f"wall-{wall}")
    return graph, values, planned


def drawn(seed: int, together: bool, faces: int) -> list[list[float]]:
    walls = np.random.default_rng(seed).normal(0, SIGMA, (60, 1 if together else faces))
    return np.broadcast_to(walls, (60, faces)).tolist()


@pytest.mark.parametrize("faces", [2, 5])
@pytest.mark.parametrize("seed", range(2))
def test_faces_that_stand_off_as_one_count_as_one_and_others_as_many(seed: int, faces: int) -> None:
    as_one, apart = (list(shared_offsets(*anchored(drawn(seed, one, faces))).values()) for one in (True, False))
    assert len(as_one) == len(apart) == 60 * faces
    assert as_one == pytest.approx([np.sqrt(faces)] * len(as_one), rel=0.01)
    assert max(apart) < 1 + 0.2 * (np.sqrt(faces) - 1) + 0.2


def test_a_lone_face_keeps_its_noise_and_of_few_faces_it_is_believed_that_they_stand_off_as_one() -> None:
    larger = list(shared_offsets(*anchored([[0.01, 0.011], [-0.02], [0.004]])).values())
    assert larger[2:] == [1.0, 1.0] and larger[0] == larger[1] == pytest.approx(np.sqrt(2), rel=0.02)


def test_only_anchors_of_the_walls_that_are_named_count_and_rooms_tell_nothing_that_walls_do_not() -> None:
    graph, values, planned = anchored(drawn(0, True, 2))
    last = max(planned)
    graph.add(factors.frame_at([0.0, 0.0, 0.0], B(0), last))
    values.insert(B(0), gtsam.Pose3())
    assert len(shared_offsets(graph, values, planned)) == 120
    assert len(shared_offsets(graph, values, {key: p for key, p in planned.items() if key != last})) == 119
    graph.add(factors.anchor_room(np.eye(4), B(0), R(0), 0.004, 0.03))
    values.insert(R(0), gtsam.Pose3())
    assert shared_offsets(graph, values, planned)[graph.size() - 1] > 100
    assert shared_offsets(graph, values, {}) == {}  # where only rooms are anchored, they count
