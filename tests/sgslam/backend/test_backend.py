"""The factor graph of a run, on loops whose truth is known."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import Array, pose
from two_rooms import CONFIG, HEIGHT, WALLS, Run, anchors_of, angle_between, built_otherwise

from sgslam.backend import Backend
from sgslam.config import Config
from sgslam.geometry.frames import inverse, local_coordinates, transform_planes
from sgslam.mapping import Anchors, KeyframeNode, PlannedWall, RoomNode, SeenWall

FAR = pose(3.0, -8.0, 12.5, 2.5)  # T_bim_building
AMID = pose(0.0, 0.0, 0.0, 2.5) @ pose(-6.0, -4.0, 0.0)  # the BIM frame lies amid the building


def in_map(run: Run, anchors: Anchors | None = None, **more: Any) -> Array:
    """T_map_local after an optimisation with anchors."""
    run.optimise(anchors, **more)
    assert run.backend.T_map_local is not None
    return run.backend.T_map_local


def test_walls_and_floor_take_the_drift_away() -> None:
    run = Run()
    assert run.errors().max() > 0.3
    run.optimise()
    assert run.errors().max() < 0.02
    for estimated, true in zip(run.backend.poses, run.truth, strict=True):
        assert angle_between(estimated[:3, :3], true[:3, :3]) < np.radians(0.3)
    np.testing.assert_allclose(run.backend.poses[0], np.eye(4), atol=1e-4)  # the map stays where it began
    T_map_building = inverse(run.T_building_map)
    assert sorted(run.backend.planes_in_map) == list(range(len(WALLS)))
    for wall, plane in run.backend.planes_in_map.items():
        np.testing.assert_allclose(plane, transform_planes(T_map_building, WALLS[wall]), atol=0.02)
    np.testing.assert_allclose(run.backend.levels_in_map[0], [0, 0, 1, HEIGHT], atol=0.01)


def turned(seen: SeenWall, degrees: float, off: float = 0.0) -> SeenWall:
    plane = transform_planes(pose(0.0, 0.0, 0.0, np.radians(degrees)), seen.plane)
    return replace(seen, plane=plane + np.array([0.0, 0.0, 0.0, off]))


def doors_ajar(run: Run) -> None:
    """One observation in twenty is turned by 6 degrees."""
    for n in range(3, len(run.seen), 20):
        run.seen[n] = turned(run.seen[n], 6)


def through_a_door(run: Run) -> None:
    """The first observation of a wall is off, as a few points through a door may show it; later ones are not."""
    first = next(n for n, s in enumerate(run.seen) if s.wall == 0)
    assert run.seen[first].keyframe > 0
    run.seen[first] = turned(run.seen[first], 4, 0.1)


def seen_once(run: Run) -> None:
    """A wall that only one keyframe saw is left to the wall map."""
    run.seen.append(SeenWall(np.array([0, -1.0, 0, 2]), np.zeros((2, 3)), (0.1, 2.0), 0.001, 0.003, 5, 99))


@pytest.mark.parametrize(
    ("spoil", "seed", "outliers", "most"),
    [(doors_ajar, 0, 0.0, 0.02), (doors_ajar, 1, 0.0, 0.02), (through_a_door, 0, 0.0, 0.02), (seen_once, 0, 0.1, 0.05)],
)
def test_wrong_observations_do_little_harm(
    spoil: Callable[[Run], None], seed: int, outliers: float, most: float
) -> None:
    run = Run(seed=seed, outliers=outliers)
    spoil(run)
    run.optimise()
    assert run.errors().max() < most and sorted(run.backend.planes_in_map) == list(range(6))


@pytest.mark.parametrize("steps", [6, 20])
def test_anchors_recover_the_bim_frame_and_can_be_withdrawn(steps: int) -> None:
    found = []
    for _ in range(2):
        run = Run()
        anchors, T_map_local = anchors_of(run, FAR, pose(0.15, -0.1, 0.1, 0.03, 0.01, -0.01))
        T = in_map(run, anchors, steps=steps)
        found.append((run.backend.poses.tobytes(), T.tobytes()))
    assert found[0] == found[1]  # the same run gives the same bits
    assert np.linalg.norm((T - T_map_local)[:3, 3]) < 0.02
    assert angle_between(T[:3, :3], T_map_local[:3, :3]) < np.radians(0.1)
    off = inverse(T) @ run.backend.poses - inverse(T_map_local) @ run.truth
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.015
    run.optimise(built_otherwise(anchors, 1, 0.3))
    run.optimise()
    assert run.backend.T_map_local is None and run.errors().max() < 0.02


def test_rooms_carry_anchors_too() -> None:
    run = Run()
    run.optimise()
    anchors, T_map_local = anchors_of(run, FAR, pose(0.1, 0.1, 0.0, 0.02))
    T_map_room, planes = inverse(run.T_building_map) @ pose(3.0, 4.0, 0.0), run.backend.planes_in_map
    room = RoomNode(7, T_map_room, {w: transform_planes(inverse(T_map_room), planes[w]) for w in range(4)})
    by_room = Anchors(anchors.T_map_local, {}, {7: FAR @ pose(3.0, 4.0, 0.0)}, anchors.elevations)
    T = in_map(run, by_room, rooms=[room])
    assert np.linalg.norm((T - T_map_local)[:2, 3]) < 0.03
    assert angle_between(T[:3, :3], T_map_local[:3, :3]) < np.radians(0.5)
    run.optimise(Anchors(anchors.T_map_local, {}, {8: np.eye(4)}, {}), [room])  # a room that is gone: no anchor at all
    assert run.errors().max() < 0.02


@pytest.mark.parametrize("metres", [0.1, 0.3, -0.2])
def test_an_anchor_that_is_far_off_hardly_pulls(metres: float) -> None:
    run = Run()
    anchors, T_map_local = anchors_of(run, AMID)
    T = in_map(run, built_otherwise(anchors, 0, -metres))
    assert np.linalg.norm((T - T_map_local)[:3, 3]) < 0.02 and run.errors().max() < 0.02


def as_built(anchors: Anchors, seed: int, times: float = 1.0) -> Anchors:
    """The same where walls stand off by so many times what the settings say."""
    rng, settings = np.random.default_rng(100 + seed), CONFIG.anchors

    def built(p: PlannedWall) -> PlannedWall:
        normal = p.plane[:3] + rng.normal(0, settings.sigma_normal, 3)
        normal /= np.linalg.norm(normal)
        off = p.plane[:3] @ p.place + p.plane[3] + rng.normal(0, times * settings.sigma_offset)
        return PlannedWall(np.array([*normal, off - normal @ p.place]), p.place)

    return replace(anchors, planes={wall: [built(p) for p in planes] for wall, planes in anchors.planes.items()})


@pytest.mark.parametrize("times", [0.3, 1.0, 2.0])
def test_poses_err_as_their_covariances_say(times: float) -> None:
    """Whether or not the building keeps to its plan as well as the settings say that it does."""
    squared, chosen = [], list(range(0, 40, 10))
    for seed in range(8):
        run = Run(count=40, seed=seed)
        anchors, T_map_local = anchors_of(run, AMID)
        T, uncertainty = in_map(run, as_built(anchors, seed, times)), run.backend.uncertainty()
        assert uncertainty is not None
        for i, P in zip(chosen, uncertainty.pose_covariances(chosen), strict=True):
            error = local_coordinates(inverse(T) @ run.backend.poses[i], inverse(T_map_local) @ run.truth[i])
            squared.append(error @ np.linalg.solve(P, error) / 6)
    assert 0.3 < np.mean(squared) < 3.0


@pytest.mark.parametrize("known", [True, False])
def test_a_map_that_tilted_is_righted_by_the_vertical_that_its_keyframes_show(known: bool) -> None:
    """The odometry rolls by 6 degrees over three of twelve steps, and there are no walls."""
    backend, up = Backend(Config()), np.array([0.0, 0.0, 1.0])
    truth = [pose(0.5 * i, 0.0, 1.2, yaw=0.05 * i) for i in range(12)]
    for i, T in enumerate(truth):
        T_odom = pose(0.0, 0.0, 0.0, roll=np.radians(2.0) * np.clip(i - 3, 0, 3)) @ T
        keyframe = KeyframeNode(i, 10**9 * i, T_odom, T_odom.copy(), step_covariance=np.eye(6) * 0.01**2)
        if known:
            keyframe.up, keyframe.sigma_up = T[:3, :3].T @ up, np.radians(0.5)
        backend.add_keyframe(keyframe)
    backend.optimise([], [], [], None, steps=20)
    cosines = [(R @ T[:3, :3].T @ up) @ up for R, T in zip(backend.poses[:, :3, :3], truth, strict=True)]
    worst = float(np.degrees(np.arccos(min(cosines))))
    assert worst < 1.0 if known else worst == pytest.approx(6.0, abs=0.1)
