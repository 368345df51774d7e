"""Factors: Jacobians by finite differences, independence of the origin, recovered frames, bad input."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, F, O, P, R, X
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import factors

Array = NDArray[np.float64]
Build = Callable[[Array], gtsam.NoiseModelFactor]
BOUNDS = ((1, 0, 0, 2.0), (-1, 0, 0, 3.0), (0, 1, 0, 1.5), (0, -1, 0, 4.0))  # walls of a box, inward normals


def random_motion(rng: np.random.Generator, reach: float = 5.0, turn: float = 0.6) -> Array:
    """(4, 4) a rigid motion of up to `reach` metres, and about `turn` radians."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rng.normal(0, turn / 2, 3)).as_matrix()
    T[:3, 3] = rng.uniform(-reach, reach, 3)
    return T


def near(T: Array, rng: np.random.Generator, size: float = 0.02) -> Array:
    """`T` moved by some centimetres and degrees."""
    return np.asarray(gtsam.Pose3(T).retract(rng.normal(0, size, 6)).matrix())


def plane_in(T_a_b: Array, plane_in_a: Array) -> Array:
    """A plane (4,) of frame a in frame b: covariant, whatever the signs of the code under test."""
    return np.asarray(T_a_b.T @ plane_in_a)


def unit(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def problem(name: str, rng: np.random.Generator) -> tuple[gtsam.NoiseModelFactor, dict[int, Array], int | None, Array]:
    """A factor, the poses (4, 4) of its variables, its plane's key and value (4,), near zero residual."""
    T_map_pose, T_map_anchor = random_motion(rng), random_motion(rng)
    seen = np.array([*unit(rng), rng.uniform(1, 4)])
    noise = factors.noise_of_plane(0.3, 0.2, None)
    poses = {X(1): T_map_pose, X(0): T_map_anchor}
    if name == "room":
        T_bim_room = random_motion(rng)
        poses = {B(0): T_map_pose, R(0): near(T_map_pose @ T_bim_room, rng, 0.001)}
        return factors.anchor_room(T_bim_room, B(0), R(0), 0.01, 0.02), poses, None, seen
    if name == "frame":
        place = rng.uniform(-5, 5, 3)
        T_bim_frame = np.eye(4)
        T_bim_frame[:3, 3] = place
        poses = {B(0): T_map_pose, X(1): near(T_map_pose @ T_bim_frame, rng, 1e-5)}
        return factors.frame_at(place, B(0), X(1)), poses, None, seen
    if name == "own":
        return factors.observe_own_plane(seen, O(0), P(0), noise), {O(0): near(np.eye(4), rng)}, P(0), seen
    if name == "storey":
        seen = np.array([0, 0, 1, -3.5])
    build = {
        "observed": lambda: factors.observe_plane(seen, X(1), X(0), P(0), noise),
        "anchored": lambda: factors.anchor_plane(seen, X(1), X(0), P(0), noise),
        "storey": lambda: factors.storey_plane(3.5, X(1), X(0), P(0), noise),
    }[name]
    T_pose_anchor = np.linalg.inv(T_map_pose) @ T_map_anchor
    return build(), poses, P(0), plane_in(T_pose_anchor, seen)


def values_of(poses: dict[int, Array], plane: int | None, value: Array, rng: np.random.Generator) -> gtsam.Values:
    values = gtsam.Values()
    for key, T in poses.items():
        values.insert(key, gtsam.Pose3(T))
    if plane is not None:
        values.insert(plane, gtsam.OrientedPlane3(value).retract(rng.normal(0, 0.05, 3)))
    return values


ALL = ("observed", "own", "anchored", "storey", "room", "frame")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ALL)
def test_jacobians_are_the_finite_differences(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factor, poses, plane, value = problem(name, rng)
    values = values_of(poses, plane, value, rng)
    linear = factor.linearize(values)
    J, b = linear.jacobian()
    assert np.linalg.norm(b) > 1e-4  # not at the optimum, where a wrong Jacobian could hide
    numeric, step = [], 1e-6
    keys = list(linear.keys())
    for key in keys:
        for axis in range(3 if key == plane else 6):
            moved = []
            for sign in (1, -1):
                delta = values.zeroVectors()
                delta.update(_one(key, sign * step * np.eye(3 if key == plane else 6)[axis]))
                moved.append(-factor.linearize(values.retract(delta)).jacobian()[1])
            numeric.append((moved[0] - moved[1]) / (2 * step))
    np.testing.assert_allclose(J, np.array(numeric).T, atol=1e-5 * max(1.0, float(np.abs(J).max())))


def _one(key: int, vector: Array) -> gtsam.VectorValues:
    values = gtsam.VectorValues()
    values.insert(key, vector)
    return values


@pytest.mark.parametrize("seed", range(3))
def test_an_anchor_near_its_wall_does_not_depend_on_where_the_bim_begins(seed: int) -> None:
    """A site may lie kilometres from zero; a wall that leans a little is off by the same."""
    rng = np.random.default_rng(seed)
    T_map_bim, T_map_anchor, noise = random_motion(rng), random_motion(rng), factors.noise_of_plane(0.01, 0.02, None)
    wall, place = np.array([*unit(rng), 2.0]), rng.uniform(-3, 3, 3)
    leaning = gtsam.OrientedPlane3(plane_in(np.linalg.inv(T_map_bim) @ T_map_anchor, wall)).retract([0.01, -0.02, 0.03])
    errors = []
    for origin in (np.zeros(3), np.array([3000.0, -2000.0, 40.0])):
        T_map_new = T_map_bim.copy()
        T_map_new[:3, 3] -= T_map_bim[:3, :3] @ origin
        new_place, new_wall = place + origin, np.array([*wall[:3], wall[3] - wall[:3] @ origin])
        values = gtsam.Values()
        for key, T in ((B(0), T_map_new), (X(0), T_map_anchor)):
            values.insert(key, gtsam.Pose3(T))
        values.insert(X(1), gtsam.Pose3(T_map_new).compose(gtsam.Pose3(gtsam.Rot3(), new_place)))
        values.insert(P(0), leaning)
        assert factors.frame_at(new_place, B(0), X(1)).error(values) < 1e-9
        near_wall = factors.plane_from(new_place, new_wall)
        errors.append(factors.anchor_plane(near_wall, X(1), X(0), P(0), noise).error(values))
    assert errors[0] > 1 and errors[1] == pytest.approx(errors[0], rel=1e-6)


@pytest.mark.parametrize("name", [name for name in ALL if name not in ("room", "frame")])
def test_a_plane_at_its_place_has_no_residual_and_a_moved_one_its_distance(name: str) -> None:
    rng = np.random.default_rng(3)
    factor, poses, plane, value = problem(name, rng)
    assert plane is not None
    if name == "own":
        poses = {O(0): np.eye(4)}
    values = gtsam.Values()
    for key, T in poses.items():
        values.insert(key, gtsam.Pose3(T))
    values.insert(plane, gtsam.OrientedPlane3(value))
    np.testing.assert_allclose(factor.unwhitenedError(values), 0, atol=1e-12)
    values.update(plane, gtsam.OrientedPlane3(value + np.array([0, 0, 0, 0.25])))
    residual = factor.unwhitenedError(values)
    np.testing.assert_allclose(np.abs(residual), [0, 0, 0.25], atol=1e-9)
    np.testing.assert_allclose(factor.whitenedError(values), residual / [0.3, 0.3, 0.2])


def test_a_robust_observation_gives_way_to_the_others() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, z in ((X(0), 0.0), (X(1), 1.0)):
        values.insert(key, gtsam.Pose3(gtsam.Rot3(), [0, 0, z]))
        graph.add(gtsam.PriorFactorPose3(key, values.atPose3(key), factors.noise_of_pose(1e-4, 1e-4)))
    robust = factors.noise_of_plane(0.01, 0.01, 1.345)
    for offset in (1.99, 2.0, 2.01, 3.0):  # one in four is a metre off
        graph.add(factors.observe_plane([0, 0, 1, offset], X(1), X(0), P(0), robust))
    values.insert(P(0), gtsam.OrientedPlane3([0, 0, 1, 1.5]))
    plane = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atOrientedPlane3(P(0))
    assert plane.planeCoefficients().ravel()[3] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_fit_room_recovers_a_known_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_bim_room = np.eye(4)
    T_bim_room[:3, :3] = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    T_bim_room[:2, 3] = rng.uniform(-50, 50, 2)
    normals = rng.normal(size=(4, 2))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    in_room = np.column_stack([normals, np.zeros(4), rng.uniform(1, 4, 4)])
    in_bim = np.array([plane_in(np.asarray(np.linalg.inv(T_bim_room)), plane) for plane in in_room])
    fitted = factors.fit_room(in_bim, in_room)
    assert fitted is not None
    np.testing.assert_allclose(fitted, T_bim_room, atol=1e-9)


@pytest.mark.parametrize(
    "planes", [[], BOUNDS[:1], BOUNDS[:2], [BOUNDS[0]] * 2, [(1, 0, 0, 1), (np.cos(0.1), np.sin(0.1), 0, 1)]]
)
def test_fit_room_refuses_walls_along_which_it_could_slide(planes: list[tuple[float, ...]]) -> None:
    walls = np.array(planes, dtype=float).reshape(-1, 4)
    assert factors.fit_room(walls, walls) is None


@pytest.mark.parametrize("bad", [0.0, -0.1, np.nan, np.inf])
def test_noise_refuses_sigmas_that_cannot_be(bad: float) -> None:
    for build in (
        lambda: factors.noise_of_plane(bad, 0.1, None),
        lambda: factors.noise_of_plane(0.1, bad, 1.345),
        lambda: factors.noise_of_pose(bad, 0.1),
        lambda: factors.noise_of_pose(0.1, bad, 1.345),
        lambda: factors.anchor_room(np.eye(4), B(0), R(0), bad, 0.1),
        lambda: factors.anchor_room(np.eye(4), B(0), R(0), 0.1, bad),
    ):
        with pytest.raises(ValueError, match="sigmas"):
            build()
    if not np.isinf(bad):
        with pytest.raises(ValueError, match="huber"):
            factors.noise_of_plane(0.1, 0.1, bad)


@pytest.mark.parametrize(
    "bad", [[1, 1, 0, 2], [0, 0, 0, 1], [1, 0, 0], [1, 0, 0, np.nan], [np.nan, 0, 0, 1], [1, 0, 0, 1, 0]]
)
def test_planes_are_refused_unless_four_finite_numbers_with_a_unit_normal(bad: list[float]) -> None:
    noise = factors.noise_of_plane(0.1, 0.1, None)
    builds: list[Build] = [
        lambda plane: factors.observe_plane(plane, X(1), X(0), P(0), noise),
        lambda plane: factors.observe_own_plane(plane, O(0), P(0), noise),
        lambda plane: factors.anchor_plane(plane, B(0), X(0), P(0), noise),
    ]
    for build in builds:
        with pytest.raises(ValueError, match="unit normal"):
            build(np.array(bad, dtype=float))


@pytest.mark.parametrize("place", [[0, 0], [0, 0, np.nan], [np.inf, 0, 0]])
def test_a_place_is_three_finite_numbers(place: list[float]) -> None:
    for build in (lambda: factors.frame_at(place, B(0), X(7)), lambda: factors.plane_from(place, BOUNDS[0])):
        with pytest.raises(ValueError, match="a place must be three finite numbers"):
            build()
    T_bim_room = np.eye(4)
    T_bim_room[0, 3] = np.nan
    with pytest.raises(ValueError, match="T_bim_room"):
        factors.anchor_room(T_bim_room, B(0), R(0), 0.1, 0.1)
    with pytest.raises(ValueError, match="unit normal"):
        factors.storey_plane(np.nan, B(0), X(0), F(0), factors.noise_of_plane(0.1, 0.1, None))
