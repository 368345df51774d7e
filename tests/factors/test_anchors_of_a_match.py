"""The planes of one's own graph are anchored by a match, and what does not fit is reported in a line."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

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


def anchors_of(found: MatchResult, plan: Any = ROOM, keys: dict[str, PlaneKeys] = KEYS, **more: Any) -> factors.Anchors:
    """Of the walls of the room, or of those of a plan that is another one."""
    return factors.anchors_of(found, plan, keys, own_graph()[1], B(0), **more)


def frame_found(anchors: factors.Anchors, floor: float | None = None) -> gtsam.Pose3:
    """T_bim_map, or that of the origin; with the height of a floor (m) or without."""
    graph, values = own_graph()
    graph.push_back(anchors.graph())
    values.insert(anchors.start)
    if floor is not None:
        seen = T_BIM_MAP.matrix().T @ [0, 0, 1, -floor]
        graph.add(factors.observe_own_plane(seen, O(0), F(0), EXACT))
        graph.add(factors.storey_plane(floor, B(0), X(0), F(0), EXACT))
        values.insert(F(0), gtsam.OrientedPlane3(seen))
    return gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(B(0)).inverse()


def test_the_frame_is_found_from_a_match_that_is_a_little_off() -> None:
    off = match(T_a_s=(T_A_S[0] + 0.05, T_A_S[1] + 0.3, T_A_S[2] - 0.2))
    anchors = anchors_of(off, height=4.5)
    assert anchors.graph().size() == 1 + 2 * 4 and set(anchors.walls) == set(KEYS)
    begun = gtsam.Pose3(anchors.T_map_bim).inverse()
    np.testing.assert_allclose(begun.matrix()[:2], gtsam.Pose3(off.matrix).matrix()[:2], atol=1e-9)
    assert begun.z() == pytest.approx(4.5)
    step = (T_BIM_MAP.inverse() * frame_found(anchors)).matrix()
    assert np.abs(step[:2, 3]).max() < 1e-3 and abs(np.arctan2(step[1, 0], step[0, 0])) < 1e-4


@pytest.mark.parametrize(("floor", "height"), [(None, 0.0), (3.5, 4.5)])
def test_a_floor_gives_the_height_that_walls_leave(floor: float | None, height: float) -> None:
    assert frame_found(anchors_of(match()), floor).z() == pytest.approx(height, abs=0.01)


def test_on_a_far_site_an_origin_in_the_building_is_needed_and_used() -> None:
    far = np.array([3.0e5, -2.0e5])
    walls = tuple(
        replace(w, centroid=tuple((np.array(w.centroid) + far).tolist()), room=None) for w in ROOM.wall_surfaces
    )
    plan, (x, y) = SceneGraph("bim", (), walls), (far + SITE).tolist()
    found = match(T_a_s=(T_A_S[0] + 0.05, T_A_S[1] + far[0] + 0.3, T_A_S[2] + far[1] - 0.2))
    for origin, message in (
        ((0.0, 0.0, 0.0), r"is 360595 m from .*, origin=\(300034.0, -200020.0, 4.0\)"),
        ((x + 302.0, y + 3, 0.0), "from the origin"),  # of walls at x 0 to 8
        ((0.0, 0.0), "origin must be three finite numbers"),
        ((0.0, 0.0, np.nan), "origin must be three finite numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            anchors_of(found, plan, height=4.5, origin=origin)
    anchors_of(found, plan, origin=(x + 294.0, y + 3, 0.0))
    T_origin_map = frame_found(anchors_of(found, plan, height=4.5, origin=(x, y, 4.0)))
    np.testing.assert_allclose(T_origin_map.translation(), T_BIM_MAP.translation() - [*SITE, 4.0], atol=1e-3)


def turned_wall(degrees: float) -> SceneGraph:
    """The plan with its first wall turned."""
    first, R = ROOM.wall_surfaces[0], gtsam.Rot2.fromDegrees(degrees).matrix()
    return replace(ROOM, wall_surfaces=(replace(first, normal=tuple(R @ first.normal)), *ROOM.wall_surfaces[1:]))


@pytest.mark.parametrize(
    ("degrees", "message"),
    [(180, "'w0' faces away from"), (121, "faces away"), (119, "turned 119 deg"), (61, "turned"), (59, None)],
)
def test_walls_that_face_away_or_cross_are_reported(degrees: float, message: str | None) -> None:
    for sign in (1, -1):
        with pytest.raises(ValueError, match=message) if message else nullcontext():
            anchors_of(match(), turned_wall(sign * degrees))


@pytest.mark.parametrize(("degrees", "enough"), [(None, False), (0, False), (180, False), (9, False), (11, True)])
def test_walls_of_one_direction_are_not_enough_for_a_new_frame(degrees: float | None, enough: bool) -> None:
    """Whether two of them face each other or not; a second wall at 11 degrees is across."""
    walls = tuple(
        WallSurface(f"a{k}", None, (float(4 * k), 1.0), (float(np.cos(a)), float(np.sin(a))), 2.0)
        for k, a in enumerate(np.radians([0.0] if degrees is None else [0.0, degrees]))
    )
    found = MatchResult("unique", "", (), tuple((f"w{k}", w.id, 1.0) for k, w in enumerate(walls)), T_A_S)
    plan = SceneGraph("bim", (), walls)
    with nullcontext() if enough else pytest.raises(ValueError, match="parallel"):
        assert factors.anchors_of(found, plan, KEYS, own_graph(plan)[1], B(0)).prior is not None


@pytest.mark.parametrize(
    ("found", "keys", "message"),
    [
        (replace(match(), status="ambiguous", reason="two places"), {}, r"'ambiguous' \(two places\)"),
        (MatchResult("none", "no place"), {}, "'none'"),
        (replace(match(), wall_surfaces=()), {}, "pairs no wall surface"),
        (match([*IDS[:3], "elsewhere"]), {}, "the plan has no wall surface 'elsewhere'"),
        (match([*IDS, IDS[0]]), {}, "no keys are given for the matched wall surface 'w4'"),
        (match(), {"w0": PlaneKeys(P(50), X(0), W(0))}, "the values have no plane p50 of wall surface 'w0'"),
        (match(), {"w0": PlaneKeys(P(0), X(50), W(0))}, "the values have no anchor x50 of wall surface 'w0'"),
        (match(), {"w0": PlaneKeys(P(0), X(0), W(1))}, "the frame's key w1 of wall surface 'w1' is in use"),
        (match(), {"w0": PlaneKeys(P(0), X(0), X(0))}, "the frame's key x0 of wall surface 'w0' is in use"),
    ],
)
def test_a_match_or_keys_that_do_not_fit_are_reported(found: MatchResult, keys: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        anchors_of(found, keys=KEYS | keys)


def test_a_plan_of_another_class_serves_and_points_in_space_are_reported() -> None:
    own = {w.id: SimpleNamespace(centroid=w.centroid, normal=w.normal) for w in ROOM.wall_surfaces}
    assert set(anchors_of(match(), SimpleNamespace(surface_by_id=own)).walls) == set(KEYS)
    x, y = ROOM.wall_surfaces[0].centroid
    for name, centroid, normal in (("centroid", (x, y, 1.2), (1.0, 0.0)), ("normal", (x, y), (1.0, 0.0, 0.0))):
        plan = SimpleNamespace(surface_by_id=own | {IDS[0]: SimpleNamespace(centroid=centroid, normal=normal)})
        with pytest.raises(ValueError, match=f"the {name} of the planned wall surface '{IDS[0]}'.*is expected"):
            anchors_of(match(), plan)


@pytest.mark.parametrize("bad", [np.eye(5), np.full((6, 6), np.nan), -np.eye(6), np.triu(np.ones((6, 6)))])
def test_a_covariance_whitens_and_what_is_none_is_refused(bad: Array) -> None:
    with pytest.raises(ValueError, match="covariance"):
        factors.noise_of_covariance(bad)
    noise = factors.noise_of_covariance(np.diag([0.01**2] * 3 + [0.1**2] * 3), 3.0)
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(X(1), gtsam.Pose3(gtsam.Rot3(), np.array([0.2, 0.0, 0.0])))
    error = gtsam.BetweenFactorPose3(X(0), X(1), gtsam.Pose3(), noise).error(values)
    assert error == pytest.approx(2.0, rel=1e-6)  # two sigma, below the robust threshold
