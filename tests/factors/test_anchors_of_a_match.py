"""The planes of one's own graph are anchored by a match, and what does not fit is reported in a line."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, F, O, P, W, X
from numpy.typing import NDArray
from plans import a_graph, box

import factors
from data import SceneGraph, WallSurface
from factors import PlaneKeys
from matching import MatchResult

Array = NDArray[np.float64]
SITE = np.array([30.0, -20.0])
ROOM = a_graph([box(SITE[0], SITE[1], 8.0, 6.0)])
IDS = [w.id for w in ROOM.wall_surfaces]
T_BIM_MAP = gtsam.Pose3(gtsam.Rot3.Yaw(0.4), np.array([*(SITE + 2.0), 4.5]))
T_A_S = (0.4, SITE[0] + 2.0, SITE[1] + 2.0)
KEYS = {f"w{k}": PlaneKeys(P(k), X(0), W(k)) for k in range(4)}
EXACT = factors.noise_of_plane(0.01, 0.02, None)


def match(ids: Sequence[str] = IDS, T_a_s: tuple[float, float, float] = T_A_S) -> MatchResult:
    pairs = tuple((f"w{k}", a_id, 1.0) for k, a_id in enumerate(ids))
    return MatchResult("unique", "all fits", (), pairs, T_a_s)


def own_graph(plan: SceneGraph = ROOM) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The walls as one pose sees them that the map begins at."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key in (O(0), X(0)):
        graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(), factors.noise_of_pose(1e-4, 1e-4)))
        values.insert(key, gtsam.Pose3())
    for k, wall in enumerate(plan.wall_surfaces):
        seen = T_BIM_MAP.matrix().T @ factors.plane_from_wall(wall.normal, wall.centroid)
        graph.add(factors.observe_own_plane(seen, O(0), P(k), factors.noise_of_plane(0.001, 0.002, None)))
        values.insert(P(k), gtsam.OrientedPlane3(seen))
    return graph, values


def test_the_frame_is_found_from_a_match_that_is_a_little_off() -> None:
    graph, values = own_graph()
    off = (T_A_S[0] + 0.05, T_A_S[1] + 0.3, T_A_S[2] - 0.2)
    anchors = factors.anchors_of(match(T_a_s=off), ROOM, KEYS, values, B(0), height=4.5)
    graph.push_back(anchors.graph())
    values.insert(anchors.start)
    assert anchors.graph().size() == 1 + 2 * 4 and set(anchors.walls) == set(KEYS)
    begun = gtsam.Pose3(anchors.T_map_bim).inverse()
    np.testing.assert_allclose(begun.matrix()[:2], gtsam.Pose3(match(T_a_s=off).matrix).matrix()[:2], atol=1e-9)
    assert begun.z() == pytest.approx(4.5)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(B(0))
    step = found.compose(T_BIM_MAP).matrix()
    assert np.abs(step[:2, 3]).max() < 1e-3 and abs(np.arctan2(step[1, 0], step[0, 0])) < 1e-4


def test_at_the_truth_no_anchor_has_an_error_and_a_wall_built_elsewhere_has_its_offset() -> None:
    _, values = own_graph()
    anchors = factors.anchors_of(match(), ROOM, KEYS, values, B(0), height=4.5, noise=EXACT)
    values.insert(anchors.start)
    assert max(factor.error(values) for pair in anchors.walls.values() for factor in pair) < 1e-9
    x, y = ROOM.wall_surfaces[0].normal
    moved = replace(ROOM.wall_surfaces[0], centroid=tuple(ROOM.wall_surfaces[0].centroid + 0.3 * np.array([x, y])))
    plan = replace(ROOM, wall_surfaces=(moved, *ROOM.wall_surfaces[1:]))
    _, values = own_graph()
    anchors = factors.anchors_of(match(), plan, KEYS, values, B(0), height=4.5, noise=EXACT)
    values.insert(anchors.start)
    np.testing.assert_allclose(np.abs(anchors.walls["w0"][1].unwhitenedError(values)), [0, 0, 0.3], atol=1e-8)


def test_keys_of_walls_that_are_not_matched_do_no_harm_and_two_pieces_may_be_one_wall() -> None:
    _, values = own_graph()
    keys = KEYS | {"piece": PlaneKeys(P(0), X(0), W(9)), "other": PlaneKeys(P(77), X(77), W(77))}
    pairs = (*match().wall_surfaces, ("piece", IDS[0], 0.9))
    anchors = factors.anchors_of(replace(match(), wall_surfaces=pairs), ROOM, keys, values, B(0))
    assert set(anchors.walls) == {*KEYS, "piece"} and anchors.start.exists(W(9)) and not anchors.start.exists(W(77))


def test_in_isam2_anchors_come_are_let_go_and_come_again() -> None:
    graph, values = own_graph()
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    isam = gtsam.ISAM2(parameters)
    isam.update(graph, values)
    first = factors.anchors_of(match(), ROOM, KEYS, isam.calculateEstimate(), B(0), height=4.5)
    indices = list(isam.update(first.graph(), first.start).getNewFactorsIndices())
    assert len(indices) == 9
    isam.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), indices[-2:])  # frame and anchor of the last wall
    held = isam.calculateEstimate()
    assert not held.exists(W(3)) and held.exists(W(2)) and held.exists(B(0))
    again = replace(match(), wall_surfaces=match().wall_surfaces[3:])
    second = factors.anchors_of(again, ROOM, KEYS, held, B(0), height=4.5)  # one wall suffices where the frame is held
    assert second.prior is None and not second.start.exists(B(0)) and second.graph().size() == 2
    isam.update(second.graph(), second.start)
    step = isam.calculateEstimate().atPose3(B(0)).compose(T_BIM_MAP)
    assert np.abs(step.translation()).max() < 1e-3


def test_on_a_far_site_an_origin_in_the_building_is_asked_for_and_used() -> None:
    far = np.array([3.0e5, -2.0e5])
    walls = tuple(replace(w, centroid=tuple((np.array(w.centroid) + far).tolist())) for w in ROOM.wall_surfaces)
    plan, site = SceneGraph("bim", (), tuple(replace(w, room=None) for w in walls)), (far + SITE).tolist()
    found = match(T_a_s=(T_A_S[0] + 0.05, T_A_S[1] + far[0] + 0.3, T_A_S[2] + far[1] - 0.2))
    with pytest.raises(ValueError, match=r"is 360595 m from .*, origin=\(300034.0, -200020.0, 4.0\)"):
        factors.anchors_of(found, plan, KEYS, own_graph()[1], B(0), height=4.5)
    for away, is_near in ((294.0, True), (302.0, False)):  # of the origin from walls at x 0 to 8
        with nullcontext() if is_near else pytest.raises(ValueError, match="from the origin"):
            factors.anchors_of(found, plan, KEYS, own_graph()[1], B(0), origin=(site[0] + away, site[1] + 3, 0.0))
    for origin in ((0.0, 0.0), (0.0, 0.0, np.nan)):
        with pytest.raises(ValueError, match="origin must be three finite numbers"):
            factors.anchors_of(found, plan, KEYS, own_graph()[1], B(0), origin=origin)
    graph, values = own_graph()
    anchors = factors.anchors_of(found, plan, KEYS, values, B(0), height=4.5, origin=(*site, 4.0))
    graph.push_back(anchors.graph())
    values.insert(anchors.start)
    T_origin_map = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(B(0)).inverse()
    expected = T_BIM_MAP.translation() - np.array([*SITE, 4.0])
    np.testing.assert_allclose(T_origin_map.translation(), expected, atol=1e-3)


def turned_wall(by: float) -> SceneGraph:
    """The plan with its first wall turned by an angle (rad)."""
    first = ROOM.wall_surfaces[0]
    (x, y), c, s = first.normal, np.cos(by), np.sin(by)
    return replace(ROOM, wall_surfaces=(replace(first, normal=(c * x - s * y, s * x + c * y)), *ROOM.wall_surfaces[1:]))


def test_walls_that_face_away_or_cross_are_told() -> None:
    _, values = own_graph()
    for degrees, told in ((180, "'w0' faces away from"), (121, "faces away"), (119, "turned 119 deg"), (61, "turned")):
        for by in (np.radians(degrees), -np.radians(degrees)):
            with pytest.raises(ValueError, match=told):
                factors.anchors_of(match(), turned_wall(by), KEYS, values, B(0))
    assert factors.anchors_of(match(), turned_wall(np.radians(59)), KEYS, values, B(0)).walls


def test_walls_of_one_direction_are_not_enough_for_a_new_frame() -> None:
    """Whether two of them face each other or not; a second wall at 11 degrees is across."""
    for angle, enough in ((0.0, False), (np.pi, False), (np.radians(9), False), (np.radians(11), True)):
        walls = tuple(
            WallSurface(f"a{k}", None, (float(4 * k), 1.0), (float(np.cos(a)), float(np.sin(a))), 2.0)
            for k, a in enumerate((0.0, angle))
        )
        plan = SceneGraph("bim", (), walls)
        _, values = own_graph(replace(ROOM, rooms=(), wall_surfaces=walls))
        pairs = tuple((f"w{k}", f"a{k}", 1.0) for k in range(2))
        found = MatchResult("unique", "", (), pairs, T_A_S)
        if enough:
            assert factors.anchors_of(found, plan, KEYS, values, B(0)).prior is not None
        else:
            with pytest.raises(ValueError, match="parallel"):
                factors.anchors_of(found, plan, KEYS, values, B(0))
    with pytest.raises(ValueError, match="parallel"):
        factors.anchors_of(match(IDS[:1]), ROOM, KEYS, own_graph()[1], B(0))


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (replace(match(), status="ambiguous", reason="two places"), r"'ambiguous' \(two places\)"),
        (MatchResult("none", "no place"), "'none'"),
        (replace(match(), wall_surfaces=()), "pairs no wall surface"),
        (match([*IDS[:3], "elsewhere"]), "the plan has no wall surface 'elsewhere'"),
        (match([*IDS, IDS[0]]), "no keys are given for the matched wall surface 'w4'"),
    ],
)
def test_a_match_that_does_not_fit_is_told(found: MatchResult, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        factors.anchors_of(found, ROOM, KEYS, own_graph()[1], B(0))


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (PlaneKeys(P(50), X(0), W(0)), "the values have no plane p50 of wall surface 'w0'"),
        (PlaneKeys(P(0), X(50), W(0)), "the values have no anchor x50 of wall surface 'w0'"),
        (PlaneKeys(P(0), X(0), W(1)), "the frame's key w1 of wall surface 'w1' is in use"),
        (PlaneKeys(P(0), X(0), X(0)), "the frame's key x0 of wall surface 'w0' is in use"),
    ],
)
def test_keys_that_do_not_fit_are_told(keys: PlaneKeys, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        factors.anchors_of(match(), ROOM, KEYS | {"w0": keys}, own_graph()[1], B(0))


class Surface:
    """A planned surface of another library."""

    def __init__(self, centroid: tuple[float, ...], normal: tuple[float, ...]) -> None:
        self.centroid, self.normal = centroid, normal


class OtherPlan:
    """A plan of another library."""

    def __init__(self, surfaces: dict[str, Surface]) -> None:
        self.surface_by_id = surfaces


def test_a_plan_of_another_class_serves_and_points_in_space_are_told() -> None:
    own = {w.id: Surface(w.centroid, w.normal) for w in ROOM.wall_surfaces}
    assert set(factors.anchors_of(match(), OtherPlan(own), KEYS, own_graph()[1], B(0)).walls) == set(KEYS)  # type: ignore[arg-type]
    x, y = ROOM.wall_surfaces[0].centroid
    for surface, told in ((Surface((x, y, 1.2), (1.0, 0.0)), "centroid"), (Surface((x, y), (1.0, 0.0, 0.0)), "normal")):
        with pytest.raises(ValueError, match=f"the {told} of the planned wall surface '{IDS[0]}'.*is expected"):
            factors.anchors_of(match(), OtherPlan(own | {IDS[0]: surface}), KEYS, own_graph()[1], B(0))  # type: ignore[arg-type]


def test_a_floor_gives_the_height_that_walls_leave() -> None:
    for floor in (False, True):
        graph, values = own_graph()
        anchors = factors.anchors_of(match(), ROOM, KEYS, values, B(0))
        graph.push_back(anchors.graph())
        values.insert(anchors.start)
        if floor:
            seen = T_BIM_MAP.matrix().T @ [0, 0, 1, -3.5]
            graph.add(factors.observe_own_plane(seen, O(0), F(0), EXACT))
            graph.add(factors.storey_plane(3.5, B(0), X(0), F(0), EXACT))
            values.insert(F(0), gtsam.OrientedPlane3(seen))
        found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(B(0)).inverse()
        assert found.z() == pytest.approx(4.5 if floor else 0.0, abs=0.01)
