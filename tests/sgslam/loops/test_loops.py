"""Loop closure with known truth: candidates, search, registration and acceptance."""

import functools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, Box, pose, scan, scene_of

from data.simulation import Sensor
from sgslam.backend import Backend
from sgslam.config import Config, SurfaceSettings
from sgslam.config.models import LoopSettings
from sgslam.geometry.frames import inverse
from sgslam.loops import LoopCloser
from sgslam.loops.pass_alignment import Submap, register
from sgslam.mapping import Closure, KeyframeNode, WallMap
from sgslam.mapping.level_map import Register
from sgslam.perception import keyframe_scan
from sgslam.surfels import SurfelMap

SETTINGS = LoopSettings()
SENSOR = Sensor(azimuths=450)


def offices(count: int, near: float, axis: int = 0) -> list[Box]:
    """Identical ones along both sides of the axis x or y, with their doors and cupboards, from so many metres off."""
    end, parts = 1.65 * count, [(-1.2, 0.0, 0.0, 0.12), (0.0, 0.06, 0.0, 4.6)]
    parts = [p for a, b, c, d in parts for p in ((a - end, b - end, c, d), (end - b, end - a, c, d))]
    for x in 3.3 * np.arange(count) - end:
        parts += [(x - 0.06, x + 0.06, 0.0, 4.6), (x, x + 1.2, 0.0, 0.12), (x + 2.1, x + 3.3, 0.0, 0.12)]
        parts += [(x, x + 3.3, 4.6, 4.7), (x + 2.8, x + 3.3, 1.5, 2.7)]
    sides = [(a, b, *sorted((side * (near + c), side * (near + d)))) for side in (-1, 1) for a, b, c, d in parts]
    return [(a, c, 0, b, d, 2.8) if axis == 0 else (c, a, 0, d, b, 2.8) for a, b, c, d in sides]


LEVEL: list[Box] = [(-60, -60, -0.1, 60, 60, 0), (-60, -60, 2.8, 60, 60, 2.9)]
X, Y = 1.65 * 6, 1.65 * 4  # m, half of the ring
RING = [(-X + 1, -Y + 1, 0, X - 1, Y - 1, 2.8), *offices(6, Y + 1), *offices(4, X + 1, axis=1), *LEVEL]
AROUND = np.array([[0.0, -Y], [X, -Y], [X, Y], [-X, Y], [-X, -Y], [0.0, -Y], [X, -Y]])
CORRIDOR = [*offices(20, 1.0), (-33.1, -1, 0, -33, 1, 2.8), (33, -1, 0, 33.1, 1, 2.8), *LEVEL]
ALONG = np.array([[-32.0, 0.0], [32.0, 0.0]])


def scanned(seed: int, around: list[tuple[float, float]], T_map_frame: Array) -> Submap:
    """What is seen from places around a corner of the ring."""
    poses = np.stack([pose(X + x, y - Y) for x, y in around])
    clouds = [scan(scene_of(RING), T, SENSOR, 10 * seed + k).astype(np.float32) for k, T in enumerate(poses)]
    return Submap.of(clouds, inverse(T_map_frame) @ poses)


def test_registration_recovers_a_motion_and_knows_its_error() -> None:
    T_true, there = pose(0.2, -0.15, 0.03, 0.03), scanned(0, [(-2.0, 0.0), (0.0, 0.0), (0.0, 2.0)], np.eye(4))
    found = register(there, scanned(1, [(-1.0, 0.0), (0.0, 1.0)], T_true), np.eye(4))
    assert found is not None
    assert np.linalg.norm(found.T_target_source[:3, 3] - T_true[:3, 3]) < 0.02
    assert found.inliers > 0.9 and found.held > 0.04


@functools.cache
def looked_at(building: str) -> tuple[Array, list[KeyframeNode], dict[int, Array]]:
    """The truth (K, 4, 4), keyframes at it and their clouds: round the ring and on, or once along a corridor."""
    steps, boxes, corners = [], *((RING, AROUND) if building == "ring" else (CORRIDOR, ALONG))
    for a, b in pairwise(corners):
        ahead = (b - a) / np.linalg.norm(b - a)
        way = np.arange(0.0, np.linalg.norm(b - a), 1.2)[:, None]
        steps += [pose(*p, 0.8, float(np.arctan2(ahead[1], ahead[0]))) for p in a + way * ahead]
    nothing, scene = SurfelMap().surfels(), scene_of(boxes)
    truth, keyframes, clouds = inverse(steps[0]) @ np.array(steps), [], {}
    for i, T in enumerate(steps):
        points = scan(scene, T, SENSOR, i)
        clouds[i] = points[::4].astype(np.float32)
        keyframe = KeyframeNode(i, i, truth[i], truth[i])
        keyframe.outline = keyframe_scan(points, nothing, np.eye(4), np.array([0.0, 0.0, 1.0]), 0.8, Config()).contour
        keyframes.append(keyframe)
    return truth, keyframes, clouds


def closed(building: str, slip: tuple[float, float]) -> tuple[Array, LoopCloser]:
    """After looks at a growing map, which is not optimised, by an odometry that slips by (rad, share) a step."""
    truth, keyframes, clouds = looked_at(building)
    drifted, T = [keyframes[0]], np.eye(4)
    for keyframe, step in zip(keyframes[1:], inverse(truth[:-1]) @ truth[1:], strict=True):
        T = T @ (step @ pose(slip[1] * np.linalg.norm(step[:3, 3]), 0.0, 0.0, slip[0]))
        drifted.append(replace(keyframe, T_map_sensor=T, T_track_sensor=T))
    walls, closer = WallMap(SurfaceSettings(), Register()), LoopCloser(SETTINGS)
    walls.T_level_map = pose(0.0, 0.0, 0.8, 0.0)
    for count in range(6, len(keyframes) + 6, 6):
        closer.look(drifted[:count], 0, walls.T_level_map, clouds)
    return truth, closer


@pytest.mark.parametrize("slip", [(0.0, 0.001), (0.0005, 0.01)])
def test_a_ring_is_closed_where_it_was_begun(slip: tuple[float, float]) -> None:
    truth, closer = closed("ring", slip)
    assert closer.closures, "it came back to where it began"
    for c in closer.closures:
        off = inverse(inverse(truth[c.earlier]) @ truth[c.later]) @ c.T_earlier_later
        assert np.linalg.norm(off[:3, 3]) < 0.1
    much = [c for c in closer.closures if c.correction > 0.3]
    assert not much or len(closer.closures) >= 3


def test_no_loop_is_closed_along_equal_offices() -> None:
    assert not closed("corridor", (0.0005, 0.02))[1].closures


def closure(earlier: int, later: int, x: float) -> Closure:
    covariance = np.diag([1e-5] * 3 + [4e-4] * 3)
    return Closure(earlier, later, pose(x, 0.0, 0.0), covariance, 1.0, 0.0, "for a test")


def back_end(count: int) -> Backend:
    """There and back with steps that are 5 % too long: the last keyframe is at the first."""
    backend = Backend(Config())
    for i, x in enumerate([*range(count), *range(count)[::-1]]):
        slipped = pose(x * (1.0 if i < count else 1.05), 0.0, 0.0)
        backend.add_keyframe(KeyframeNode(i, i, slipped, slipped))
    return backend


def test_a_closure_is_a_factor_that_pulls_the_map_together() -> None:
    backend = back_end(10)
    last = len(backend.keyframes) - 1
    backend.closures = [closure(9, last, -9.0)]
    backend.optimise([], [], [], None, steps=20)
    assert np.linalg.norm(backend.keyframes[last].T_map_sensor[:3, 3]) < 0.05
    assert list(backend.held["loop"]) == [(last, 9)]
    backend.closures = []
    backend.optimise([], [], [], None, steps=20)
    assert not backend.held["loop"]


def test_a_closure_that_the_others_contradict_is_given_up() -> None:
    backend = back_end(10)
    closer = LoopCloser(SETTINGS, backend.closures)
    last = len(backend.keyframes) - 1
    right = [closure(k, last - k, 0.0) for k in range(4)]
    backend.closures += [*right, closure(0, last - 1, -3.0)]
    backend.optimise([], [], [], None, steps=20)
    gone = closer.contradicted(backend.keyframes)
    assert [c.T_earlier_later[0, 3] for c in gone] == [-3.0] and backend.closures == right
