"""The joint adjustment of keyframes and walls, in a flat whose walls and keyframes are known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from data.scene_graph import Floor, SceneGraph, WallSurface
from sgslam.adjustment import Steps, faces_of, pose_errors, wall_points
from sgslam.geometry.frames import se2_to_se3

Array = NDArray[np.float64]
SIZE, DEPTH, ROOMS, LENGTH = 4.0, 5.0, 5, 20.0  # m: five rooms in a row
BUILT, SHARED = 0.012, 0.004  # m
SENSOR = 1.0  # m above the floor


def _surface(id: str, source: str, x: float, y: float, normal: tuple[float, float], length: float) -> WallSurface:
    return WallSurface(id, None, (x, y), normal, length, "0", source, (0.0, 2.6))


def _plan() -> SceneGraph:
    """The rooms' own walls at their ends and sides; partitions are 0.2 m thick."""
    surfaces = []
    for k in range(ROOMS):
        x = SIZE * (k + 0.5)
        surfaces += [
            _surface(f"s{k}", f"south{k}", x, 0.0, (0.0, 1.0), SIZE - 0.2),
            _surface(f"n{k}", f"north{k}", x, DEPTH, (0.0, -1.0), SIZE - 0.2),
            _surface(f"w{k}", f"partition{k}", x - SIZE / 2 + 0.1, DEPTH / 2, (1.0, 0.0), DEPTH),
            _surface(f"e{k}", f"partition{k + 1}", x + SIZE / 2 - 0.1, DEPTH / 2, (-1.0, 0.0), DEPTH),
        ]
    return SceneGraph("bim", (), tuple(surfaces), (), (Floor("0", "0", 0.0),))


def _moved(plan: SceneGraph, by: dict[str, float]) -> SceneGraph:
    """The walls of these sources off by so much along x or y."""
    walls = []
    for s in plan.wall_surfaces:
        shift = by.get(s.source, 0.0) * np.abs(s.normal)
        walls.append(replace(s, centroid=(s.centroid[0] + shift[0], s.centroid[1] + shift[1])))
    return replace(plan, wall_surfaces=tuple(walls))


def _seen(built: SceneGraph, x: float, rng: np.random.Generator) -> Array:
    """(N, 3) points of the walls of the room at x, in the level sensor's frame there, with 2 cm of noise."""
    sensor = np.array([x, DEPTH / 2, SENSOR])
    points = []
    for s in built.wall_surfaces:
        n, centre = np.array(s.normal), np.array(s.centroid)
        if int(s.id[1:]) == int(x // SIZE):
            along = rng.uniform(-0.5, 0.5, 120)[:, None] * (s.length or 0.0) * np.array([-n[1], n[0]])
            on = np.column_stack([centre + along, rng.uniform(0.3, 2.3, 120)])
            away = on - sensor
            points.append(away * (1 + rng.normal(0.0, 0.02, 120) / np.linalg.norm(away, axis=1))[:, None])
    return np.concatenate(points)


def _errors_left(
    built: SceneGraph, seed: int, error: Array, sigma_step: float = 0.002, odometry: bool = True
) -> tuple[Array, Array]:
    """(K, 3) of the keyframes along the rooms: what is found of their `error` (3,) and a walk of `sigma_step` (m), and
    what is left of it."""
    rng, plan = np.random.default_rng(seed), _plan()
    x = np.arange(0.5, LENGTH, 1.0)
    true = np.stack([se2_to_se3(0.0, at, DEPTH / 2, SENSOR) for at in x])
    steps = rng.normal(0.0, 1.0, (len(x), 3)) * [sigma_step, sigma_step, sigma_step / 5]
    errors = error + np.cumsum(steps, axis=0)
    believed = np.stack([
        se2_to_se3(e[2], at + e[0], DEPTH / 2 + e[1], SENSOR) for at, e in zip(x, errors, strict=True)
    ])  # fmt: skip
    clouds = [(T, _seen(built, at, rng).astype(np.float32)) for T, at in zip(believed, x, strict=True)]
    faces = faces_of(plan)
    known = np.full(len(x), sigma_step if odometry else np.inf)
    known[0] = np.inf
    shift = np.diff(true[:, :2, 3], axis=0, prepend=true[:1, :2, 3])
    found = pose_errors(faces, wall_points(faces, clouds), Steps(shift, known, known / 5), BUILT, SHARED)
    return found, found - errors


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))


@pytest.mark.parametrize("seed", range(4))
def test_the_error_of_a_whole_map_is_found(seed: int) -> None:
    _, left = _errors_left(_plan(), seed, np.array([0.009, -0.006, 0.001]))
    assert _rms(left) < 0.0035  # of 11 mm; at most 2.9 mm over 30 seeds
    assert np.abs(left[:, 2]).max() < 0.005


@pytest.mark.parametrize("seed", range(4))
def test_moved_walls_do_not_pull_the_map(seed: int) -> None:
    """A third of the walls of each direction is off by 15 mm, all to one side: their mean would be 5 mm off. At
    most 2.6 mm over 30 seeds."""
    by = {"partition1": 0.015, "partition3": 0.015, "south0": 0.015, "south3": 0.015, "north2": 0.015}
    _, left = _errors_left(_moved(_plan(), by), seed, np.zeros(3))
    assert abs(float(np.mean(left[:, 0]))) < 0.0035
    assert abs(float(np.mean(left[:, 1]))) < 0.0035


def test_what_is_no_wall_tells_nothing() -> None:
    """Partitions that stand 30 cm elsewhere are other things; the map keeps the place that it had along x."""
    by = {f"partition{k}": 0.3 for k in range(ROOMS + 1)}
    found, left = _errors_left(_moved(_plan(), by), 0, np.array([0.0, 0.008, 0.0]))
    assert np.abs(found[:, 0]).max() < 0.003
    assert abs(float(np.mean(left[:, 1]))) < 0.002


def test_without_odometry_each_keyframe_is_adjusted_alone() -> None:
    _, left = _errors_left(_plan(), 0, np.array([0.005, 0.005, 0.0]), sigma_step=0.01, odometry=False)
    assert _rms(left) < 0.006
    _, joined = _errors_left(_plan(), 0, np.array([0.005, 0.005, 0.0]), sigma_step=0.0005)
    assert _rms(joined) < _rms(left)


def test_both_faces_of_a_wall_move_together() -> None:
    faces, plan = faces_of(_plan()), _plan()
    of = {s.id: k for k, s in enumerate(plan.wall_surfaces)}
    assert faces.wall[of["e0"]] == faces.wall[of["w1"]]
    assert faces.sign[of["e0"]] == -faces.sign[of["w1"]]
    assert len(set(faces.wall.tolist())) == 3 * ROOMS + 1


def test_a_plan_without_walls_adjusts_nothing() -> None:
    faces = faces_of(SceneGraph("bim", (), (), (), ()))
    seen = wall_points(faces, [(np.eye(4), np.zeros((5, 3), np.float32))] * 2)
    steps = Steps(np.zeros((2, 2)), np.array([np.inf, 0.01]), np.array([np.inf, 0.01]))
    np.testing.assert_array_equal(pose_errors(faces, seen, steps, BUILT, SHARED), 0.0)
