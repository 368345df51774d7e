"""Loop closure with known truth: candidates, search, registration and acceptance."""

import functools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, pose

from data.geometry.raycast import TriangleScene
from data.simulation import SpinningSensor
from evaluation.drives.loop_buildings import LoopBuilding, long_corridor, ring
from sgslam.backend import Backend
from sgslam.config import Config, SurfaceSettings
from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import inverse
from sgslam.loops import LoopCloser
from sgslam.loops.candidates import Pass, Ties, passes_near, tied_by_walls, way_driven
from sgslam.loops.likeness import Widths, similar
from sgslam.loops.registration import Submap, register
from sgslam.mapping import Closure, KeyframeNode, WallMap
from sgslam.tracking.front_end import FrontEnd

SETTINGS = LoopSettings()
SENSOR = SpinningSensor(azimuths=450)


def passes(way: Array, tie: tuple[int, int] | None = None, like: tuple[int, ...] = ()) -> list[Pass]:
    """Those by the last of the places (K, 2), where one pair of keyframes is tied and some look alike."""
    held = Ties(np.empty((0, 2), dtype=np.int64) if tie is None else np.array([tie]))
    alike = {"walls": np.array(like, dtype=np.int64), "room": np.empty(0, np.int64)}
    return passes_near(len(way) - 1, way, way_driven(way), np.ones(len(way), bool), held, SETTINGS, alike)


def there_and_back(length: int, aside: float = 0.0) -> Array:
    """By an odometry that slips aside where it turns."""
    x = np.concatenate([np.arange(length + 1), np.arange(length)[::-1]])
    return np.column_stack([x, aside * (np.arange(len(x)) > length)]).astype(float)


def test_who_comes_back_may_be_off_by_more_the_farther_it_went_since_it_was_tied() -> None:
    assert passes(np.column_stack([np.arange(60.0), np.zeros(60)])) == [], "who never comes back"
    (near,), (far,), (tied,) = (passes(there_and_back(n), tie) for n, tie in ((12, None), (60, None), (60, (111, 9))))
    assert near.drift < far.drift <= SETTINGS.most_drift and tied.drift < 0.5 * far.drift
    assert far.keyframes.max() < 20, "only what was seen where it is now"


def test_what_is_alike_may_be_farther_off() -> None:
    way = there_and_back(30, aside=6.0)
    assert passes(way) == []
    (found,) = passes(way, like=(1, 2))
    assert found.by == "walls" and 2 in found.keyframes


@pytest.mark.parametrize(("normals", "tied"), [([[1.0, 0.0], [0.0, 1.0]], [[20, 0]]), ([[0.0, -1.0], [0.0, 1.0]], [])])
def test_walls_tie_two_passes_where_they_hold_both_directions(normals: list[list[float]], tied: list) -> None:
    way = there_and_back(10)
    saw = np.zeros((len(way), 2), dtype=np.float32)
    saw[[0, -1]] = 1.0
    assert tied_by_walls(np.array([20]), way, way_driven(way), saw, np.array(normals), 15.0).tolist() == tied


RING = ring(5, 4)
CORNER = RING.way[1]
AROUND = [(-2.0, 0.0), (0.0, 0.0), (0.0, 2.0)]


def scanned(
    seed: int, around: list[tuple[float, float]], T_map_frame: Array | None = None, building: LoopBuilding = RING
) -> Submap:
    """What is seen from places around a corner of the ring, or of another building's origin."""
    scene, rng = TriangleScene(building.triangles), np.random.default_rng(seed)
    at = CORNER if building is RING else np.zeros(2)
    poses = np.stack([pose(*(at + step), 0.8, 0.0) for step in around])
    clouds = [SENSOR.scan(scene, T, rng).astype(np.float32) for T in poses]
    return Submap.of(clouds, poses, np.eye(4) if T_map_frame is None else T_map_frame)


def test_registration_recovers_a_motion_and_knows_its_error() -> None:
    T_true = pose(0.2, -0.15, 0.03, 0.03)
    found = register(scanned(0, AROUND), scanned(1, [(-1.0, 0.0), (0.0, 1.0)], T_true), np.eye(4), SETTINGS)
    assert found is not None
    assert np.linalg.norm(found.T_target_source[:3, 3] - T_true[:3, 3]) < 0.02
    assert found.inliers > 0.9 and found.error < 0.03 and found.held > 2 * SETTINGS.held


def test_the_faces_of_a_wall_are_not_the_same_surface_and_without_points_there_is_none() -> None:
    """The same points, but seen from behind: nothing of them fits."""
    seen = scanned(0, AROUND)
    behind, none = Submap(seen.points, 2 * seen.points - seen.seen_from), Submap(seen.points[:0], seen.seen_from[:0])
    same, other = (register(seen, own, np.eye(4), SETTINGS) for own in (seen, behind))
    assert same is not None and same.inliers > 0.99
    assert other is None or other.inliers < 0.3
    assert register(none, seen, np.eye(4), SETTINGS) is None and register(seen, none, np.eye(4), SETTINGS) is None


def test_along_a_bare_corridor_a_registration_holds_nothing() -> None:
    level = RING.triangles[np.ptp(RING.triangles[:, :, 2], axis=1) == 0]
    building = replace(RING, triangles=np.concatenate([wall(1.0), wall(-1.0), level]))
    there, here = (scanned(seed, [(-1.0, 0.0), (1.0, 0.1)], building=building) for seed in (0, 1))
    found = register(there, here, np.eye(4), SETTINGS)
    assert found is not None and found.held < SETTINGS.held
    assert found.covariance[3, 3] > 1.5 * found.covariance[4, 4], "it knows less along the corridor"


def wall(y: float) -> Array:
    a, b, c, d = (-60, y, 0), (60, y, 0), (60, y, 2.8), (-60, y, 2.8)
    return np.array([[a, b, c], [a, c, d]], dtype=float)


@functools.cache
def looked_at(building: str) -> tuple[Array, list[KeyframeNode], dict[int, Array]]:
    """The truth (K, 4, 4), keyframes at it and their clouds: round the ring and on, or once along a corridor."""
    drawn = ring(6, 4) if building == "ring" else long_corridor(20)
    corners = np.concatenate([drawn.way, drawn.way[1:2]]) if building == "ring" else drawn.way
    steps = []
    for a, b in pairwise(corners):
        ahead = (b - a) / np.linalg.norm(b - a)
        way = np.arange(0.0, np.linalg.norm(b - a), 1.2)[:, None]
        steps += [pose(*p, 0.8, float(np.arctan2(ahead[1], ahead[0]))) for p in a + way * ahead]
    front_end, scene, rng = FrontEnd(Config()), TriangleScene(drawn.triangles), np.random.default_rng(0)
    truth, keyframes, clouds = inverse(steps[0]) @ np.array(steps), [], {}
    for i, T in enumerate(steps):
        points = SENSOR.scan(scene, T, rng).astype(float)
        clouds[i] = points[::4].astype(np.float32)
        keyframe = KeyframeNode(i, i, truth[i], truth[i])
        keyframe.outline = front_end.look(points, np.eye(4), np.eye(3), 0.8).contour
        keyframes.append(keyframe)
    return truth, keyframes, clouds


def closed(building: str, slip: tuple[float, float]) -> tuple[Array, LoopCloser]:
    """After looks at a growing map, which is not optimised, by an odometry that slips by (rad, share) a step."""
    truth, keyframes, clouds = looked_at(building)
    drifted, T = [keyframes[0]], np.eye(4)
    for keyframe, step in zip(keyframes[1:], inverse(truth[:-1]) @ truth[1:], strict=True):
        T = T @ (step @ pose(slip[1] * np.linalg.norm(step[:3, 3]), 0.0, 0.0, slip[0]))
        drifted.append(replace(keyframe, T_map_sensor=T, T_track_sensor=T))
    walls, closer = WallMap(SurfaceSettings()), LoopCloser(SETTINGS)
    walls.level_by(pose(0.0, 0.0, 0.8, 0.0))
    for count in range(6, len(keyframes) + 6, 6):
        closer.look(drifted[:count], 0, walls, clouds)
    return truth, closer


@pytest.mark.parametrize("slip", [(0.0, 0.001), (0.0005, 0.01)])
def test_a_ring_is_closed_where_it_was_begun(slip: tuple[float, float]) -> None:
    truth, closer = closed("ring", slip)
    assert closer.closures, "it came back to where it began"
    for c in closer.closures:
        off = inverse(inverse(truth[c.earlier]) @ truth[c.later]) @ c.T_earlier_later
        assert np.linalg.norm(off[:3, 3]) < 0.1
    much = [c for c in closer.closures if c.correction > SETTINGS.alone]
    assert not much or len(closer.closures) >= SETTINGS.together


def test_no_loop_is_closed_along_equal_offices() -> None:
    assert not closed("corridor", (0.0005, 0.02))[1].closures


def closure(earlier: int, later: int, x: float) -> Closure:
    covariance = np.diag([1e-5] * 3 + [4e-4] * 3)
    return Closure(earlier, later, pose(x, 0.0, 0.0), covariance, 1.0, 0.0, "position", "for a test")


def back_end(count: int) -> Backend:
    """There and back with steps that are 5 % too long: the last keyframe is at the first."""
    backend = Backend(Config())
    for i, x in enumerate([*range(count), *range(count)[::-1]]):
        slipped = pose(x * (1.0 if i < count else 1.05), 0.0, 0.0)
        backend.add_keyframe(KeyframeNode(i, i, slipped, slipped))
    return backend


def test_a_closure_is_a_factor_with_its_reason_that_pulls_the_map_together() -> None:
    backend = back_end(10)
    last = len(backend.keyframes) - 1
    backend.closures = [closure(9, last, -9.0)]
    backend.optimise([], [], [], None, steps=20)
    assert np.linalg.norm(backend.keyframes[last].T_map_sensor[:3, 3]) < 0.05
    event = next(e for e in backend.log.events if e.kind == "loop")
    assert (event.key, event.by, event.why) == ((last, 9), "position", "for a test")
    backend.closures = []
    backend.optimise([], [], [], None, steps=20)
    assert backend.log.counts()["loop"]["withdrawn"] == 1


def test_a_closure_that_the_others_contradict_is_given_up() -> None:
    backend = back_end(10)
    closer = LoopCloser(SETTINGS, backend.closures)
    last = len(backend.keyframes) - 1
    right = [closure(k, last - k, 0.0) for k in range(4)]
    backend.closures += [*right, closure(0, last - 1, -3.0)]
    backend.optimise([], [], [], None, steps=20)
    gone = closer.contradicted(backend.keyframes)
    assert [c.T_earlier_later[0, 3] for c, _ in gone] == [-3.0] and backend.closures == right


def room(number: int, depth: float, at: tuple[float, float], yaw: float = 0.0, walls: int = 4) -> Widths:
    """Of the inward planes of a room 3.2 m wide, seen from a place in it, turned by `yaw`."""
    n = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    d = np.array([at[0], 3.2 - at[0], at[1], depth - at[1]])
    return Widths.of(number, np.column_stack([n @ pose(0, 0, 0, yaw)[:3, :3].T, d])[:walls])


def test_a_room_is_alike_wherever_the_sensor_stands_and_however_it_is_turned() -> None:
    poses = np.array([pose(9, 9, 0, -0.8), pose(0, 0, 0), pose(3, 1, 0), pose(5, 5, 0)])
    here, corridor = room(0, 5.1, (1.0, 2.0), 0.8).turned(poses), room(3, 5.1, (1.0, 2.0), walls=2)
    known = Widths.together([room(1, 5.1, (2.5, 4.0)), room(2, 4.4, (1.0, 2.0)), corridor])
    assert similar(here, known.turned(poses)).tolist() == [1]
    assert len(similar(corridor.turned(poses), corridor.turned(poses))) == 0, "its width alone tells no corridor"
    assert len(similar(here, Widths.together([]))) == 0
