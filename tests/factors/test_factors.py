"""Factors: Jacobians by finite differences, independence of the origin, recovered frames, bad input."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

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


def angle_and_distance(T: Array, U: Array) -> tuple[float, float]:
    step = np.linalg.inv(T) @ U
    angle = np.linalg.norm(Rotation.from_matrix(step[:3, :3]).as_rotvec())
    return float(angle), float(np.linalg.norm(step[:3, 3]))


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
        "wall of room": lambda: factors.wall_of_room(seen, X(1), X(0), P(0), noise),
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


ALL = ("observed", "own", "anchored", "storey", "wall of room", "room", "frame")


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


@pytest.mark.parametrize("name", [name for name in ALL if name != "own"])
def test_the_error_does_not_depend_on_where_the_map_begins(name: str) -> None:
    rng = np.random.default_rng(7)
    factor, poses, plane, value = problem(name, rng)
    T_new_map = random_motion(rng, reach=30.0, turn=3.0)
    noise_of_value = rng.bit_generator.state
    before = factor.error(values_of(poses, plane, value, rng))
    rng.bit_generator.state = noise_of_value
    after = factor.error(values_of({key: T_new_map @ T for key, T in poses.items()}, plane, value, rng))
    assert before > 1e-6
    assert after == pytest.approx(before, rel=1e-9)


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


def recovered(planes: bool, floor: bool, rooms: bool, rng: np.random.Generator) -> tuple[Array, Array]:
    """T_map_bim as planted and as found, from keyframes that walk through two rooms of a storey at 3.5 m."""
    T_map_bim = random_motion(rng, reach=40.0, turn=0.0)
    T_map_bim[:3, :3] = Rotation.from_euler("zyx", [2.2, 0.03, -0.02]).as_matrix()
    noise = factors.noise_of_plane(0.01, 0.01, None)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    T_bim_sensor = np.eye(4)
    T_bim_sensor[:3, 3] = (0.3, 0.4, 4.3)
    T_map_sensor = T_map_bim @ T_bim_sensor
    for key, T in ((X(0), T_map_sensor), (B(0), near(T_map_bim, rng, 0.2))):
        values.insert(key, gtsam.Pose3(T))
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(T_map_sensor), factors.noise_of_pose(1e-4, 1e-4)))
    graph.add(gtsam.PriorFactorPose3(B(0), values.atPose3(B(0)), factors.noise_of_pose(10.0, 1e3)))
    if planes or floor:
        values.insert(O(0), gtsam.Pose3())
        graph.add(gtsam.PriorFactorPose3(O(0), gtsam.Pose3(), factors.noise_of_pose(1e-4, 1e-4)))
    for number, bound in enumerate(np.array(BOUNDS, dtype=float) if planes else []):
        seen = plane_in(T_bim_sensor, bound)
        graph.add(factors.observe_own_plane(seen, O(0), P(number), noise))
        graph.add(factors.anchor_plane(bound, B(0), X(0), P(number), noise))
        values.insert(P(number), gtsam.OrientedPlane3(seen))
    if floor:
        seen = plane_in(T_bim_sensor, np.array([0, 0, 1, -3.5]))
        graph.add(factors.observe_own_plane(seen, O(0), F(0), noise))
        graph.add(factors.storey_plane(3.5, B(0), X(0), F(0), noise))
        values.insert(F(0), gtsam.OrientedPlane3(seen))
    for number in range(2 if rooms else 0):
        T_bim_room = np.eye(4)
        T_bim_room[:2, 3] = (6.0 * number, 1.0)
        T_map_room = T_map_bim @ T_bim_room
        values.insert(R(number), gtsam.Pose3(T_map_room))
        graph.add(gtsam.PriorFactorPose3(R(number), gtsam.Pose3(T_map_room), factors.noise_of_pose(1e-3, 1e-3)))
        graph.add(factors.anchor_room(T_bim_room, B(0), R(number), 0.01, 0.02))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(B(0)).matrix()
    return T_map_bim, np.asarray(found)


@pytest.mark.parametrize("rooms", [False, True])
def test_planes_and_floor_recover_the_bim_frame(rooms: bool) -> None:
    truth, found = recovered(planes=True, floor=True, rooms=rooms, rng=np.random.default_rng(1))
    angle, distance = angle_and_distance(truth, found)
    assert angle < 1e-4 and distance < 1e-3


def test_walls_alone_leave_the_height_open_and_give_the_rest() -> None:
    truth, found = recovered(planes=True, floor=False, rooms=False, rng=np.random.default_rng(2))
    angle, _ = angle_and_distance(truth, found)
    step = np.linalg.inv(truth) @ found
    assert angle < 1e-4 and np.abs(step[:2, 3]).max() < 1e-3
    assert abs(step[2, 3]) > 0.01  # as the guess had it: no wall says how high the storey lies


def test_rooms_alone_recover_place_and_heading() -> None:
    truth, found = recovered(planes=False, floor=False, rooms=True, rng=np.random.default_rng(3))
    step = np.linalg.inv(truth) @ found
    assert np.abs(step[:2, 3]).max() < 5e-3 and abs(np.arctan2(step[1, 0], step[0, 0])) < 1e-3


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


def test_fit_room_averages_what_disagrees() -> None:
    in_room = np.array(BOUNDS, dtype=float)
    in_bim = in_room.copy()
    in_bim[0, 3] += 0.02  # one of the two walls across x stands 2 cm off
    fitted = factors.fit_room(in_bim, in_room)
    assert fitted is not None
    np.testing.assert_allclose(fitted[:3, 3], [-0.01, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    "planes", [[], BOUNDS[:1], BOUNDS[:2], [BOUNDS[0]] * 2, [(1, 0, 0, 1), (np.cos(0.1), np.sin(0.1), 0, 1)]]
)
def test_fit_room_refuses_walls_along_which_it_could_slide(planes: list[tuple[float, ...]]) -> None:
    walls = np.array(planes, dtype=float).reshape(-1, 4)
    assert factors.fit_room(walls, walls) is None


def test_plane_from_wall_holds_the_wall() -> None:
    normal, point = np.array([0.6, -0.8]), np.array([3.0, 5.0])
    plane = factors.plane_from_wall(normal, point)
    for along in (-2.0, 0.0, 7.0):
        on_wall = [*(point + along * np.array([0.8, 0.6])), 1.3, 1.0]
        assert plane @ on_wall == pytest.approx(0)
    assert plane @ [*(point + normal), 0, 1] == pytest.approx(1)  # the normal's side is positive


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
        lambda plane: factors.wall_of_room(plane, R(0), X(0), P(0), noise),
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


ALONE = """
import sys
allowed = {"factors", "gtsam", "gtsam_unstable", "numpy", *sys.stdlib_module_names}
class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in allowed:
            raise ImportError(f"{name} is blocked")
sys.meta_path.insert(0, Nothing())
import factors, gtsam
noise = factors.noise_of_plane(0.01, 0.02, None)
graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
graph.add(factors.observe_plane([0, 0, 1, 1.5], 1, 0, 2, noise))
for key in (0, 1):
    values.insert(key, gtsam.Pose3())
    graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(), factors.noise_of_pose(0.01, 0.01)))
values.insert(2, gtsam.OrientedPlane3([0, 0, 1, 1.0]))
plane = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atOrientedPlane3(2)
assert abs(plane.planeCoefficients().ravel()[3] - 1.5) < 1e-6
print(factors.__file__)
"""


@pytest.mark.slow
def test_the_factors_work_alone_beside_gtsam_and_numpy(tmp_path: Path) -> None:
    """Taken out of the project, with every other package blocked."""
    source = Path(factors.__file__).parent
    shutil.copytree(source, tmp_path / "factors", ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-c", ALONE]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / "factors/__init__.py")]
