"""Loop closure with known truth: candidates, search, registration and acceptance."""

import functools
from dataclasses import replace
from itertools import pairwise

import gtsam
import numpy as np
import pytest
from boxes import Array, pose

import factors
from data.geometry.raycast import TriangleScene
from data.simulation import SpinningSensor
from evaluation.drives.loop_buildings import LoopBuilding, long_corridor, ring
from sgslam.backend import Backend
from sgslam.config import Config, SurfaceSettings
from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import inverse
from sgslam.loops import LoopCloser
from sgslam.loops.candidates import Ties, passes_near, tied_by_walls, way_driven
from sgslam.loops.likeness import Widths, similar
from sgslam.loops.registration import Submap, register
from sgslam.loops.search import SeenSpace, agreement, search
from sgslam.mapping import Closure, KeyframeNode, SeenWall, WallMap
from sgslam.tracking.front_end import FrontEnd

SETTINGS = LoopSettings()
SENSOR = SpinningSensor(azimuths=450)


def passes(way: Array, ties: Array | None = None) -> list:
    """Those by the last of the places (K, 2)."""
    held = Ties(np.empty((0, 2), dtype=np.int64) if ties is None else ties)
    everywhere = np.ones(len(way), bool)
    return passes_near(len(way) - 1, way, way_driven(way), everywhere, held, SETTINGS)


def there_and_back(length: int) -> Array:
    x = np.concatenate([np.arange(length + 1), np.arange(length)[::-1]])
    return np.column_stack([x, np.zeros(len(x))]).astype(float)


def test_who_never_comes_back_is_at_no_earlier_place() -> None:
    assert passes(np.column_stack([np.arange(60.0), np.zeros(60)])) == []


def test_who_comes_back_may_be_off_by_more_the_farther_it_went() -> None:
    near, far = passes(there_and_back(12)), passes(there_and_back(60))
    assert len(near) == len(far) == 1
    assert near[0].drift < far[0].drift <= SETTINGS.most_drift
    assert far[0].keyframes.max() < 20, "only what was seen where it is now"


def test_a_tie_on_the_way_leaves_less_drift() -> None:
    way = there_and_back(60)
    tie = np.array([[len(way) - 10, 9]])
    assert passes(way, tie)[0].drift < 0.5 * passes(way)[0].drift


def test_walls_tie_two_passes_where_they_hold_both_directions() -> None:
    way = there_and_back(10)
    saw = np.zeros((len(way), 2), dtype=np.float32)
    saw[0] = saw[-1] = 1.0
    last = np.array([len(way) - 1])
    across = np.array([[1.0, 0.0], [0.0, 1.0]])
    assert tied_by_walls(last, way, way_driven(way), saw, across, 15.0).tolist() == [[len(way) - 1, 0]]
    along = np.array([[0.0, -1.0], [0.0, 1.0]])
    assert len(tied_by_walls(last, way, way_driven(way), saw, along, 15.0)) == 0


def contours(building: LoopBuilding, places: list[tuple[float, float]]) -> tuple[Array, list[Array]]:
    """Sensors (K, 2) and what each sees around it at its height, building's frame."""
    scene, angle = TriangleScene(building.triangles), np.linspace(-np.pi, np.pi, 720, endpoint=False)
    rays = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(720)])
    ranges = [scene.distances(np.array([x, y, 1.2]), rays) for x, y in places]
    found = [np.array(p) + r[:, None] * rays[:, :2] for p, r in zip(places, ranges, strict=True)]
    return np.array(places), found


def test_the_search_finds_a_known_motion_at_a_corner() -> None:
    building = ring(5, 4)
    x, y = building.way[1]
    there = SeenSpace.of(*contours(building, [(x - d, y) for d in (6.0, 4.0, 2.0, 0.0)]))
    here = SeenSpace.of(*contours(building, [(x - 5.0, y), (x - 1.0, y), (x, y + 1.0)]))
    turn, move = 0.08, np.array([0.9, -1.3])
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = (here.points - move) @ R  # the motion (turn, move) brings them back
    fit = search(there, moved, moved.mean(axis=0), 2.0, 0.15, SETTINGS)
    assert fit.agreement > 0.9 and fit.runner_up < fit.agreement - SETTINGS.distinct
    assert abs(fit.motion[0] - turn) < 0.01 and np.linalg.norm(fit.motion[1:] - move) < 0.08


def test_equal_offices_are_ambiguous() -> None:
    building = long_corridor(12)
    there = SeenSpace.of(*contours(building, [(x, 0.0) for x in np.arange(8.0, 32.0, 2.0)]))
    here = SeenSpace.of(*contours(building, [(x, 0.1) for x in np.arange(17.0, 23.0, 2.0)]))
    fit = search(there, here.points, np.array([20.0, 0.0]), 4.0, 0.05, SETTINGS)
    assert fit.agreement > 0.8 and fit.runner_up > fit.agreement - SETTINGS.distinct, "a door further on fits as well"


def test_free_space_counts_against_a_place_and_unknown_space_does_not() -> None:
    angle = np.linspace(0, 2 * np.pi, 400)
    space = SeenSpace.of(np.zeros((1, 2)), [4 * np.column_stack([np.cos(angle), np.sin(angle)])])
    assert agreement(space, space.points) == (1.0, 1.0)
    assert agreement(space, 0.5 * space.points) == (1.0, -1.0)
    assert agreement(space, space.points + 30.0)[0] == 0.0


def scanned(
    building: LoopBuilding, places: list[tuple[float, float]], seed: int, T_map_frame: Array | None = None
) -> Submap:
    scene, rng = TriangleScene(building.triangles), np.random.default_rng(seed)
    poses = np.stack([pose(x, y, 0.8, 0.0) for x, y in places])
    clouds = [SENSOR.scan(scene, T, rng).astype(np.float32) for T in poses]
    return Submap.of(clouds, poses, np.eye(4) if T_map_frame is None else T_map_frame)


def test_registration_recovers_a_motion_and_knows_its_error() -> None:
    building = ring(5, 4)
    x, y = building.way[1]
    T_true = pose(0.2, -0.15, 0.03, 0.03)
    there = scanned(building, [(x - 2, y), (x, y), (x, y + 2)], 0)
    here = scanned(building, [(x - 1, y), (x, y + 1)], 1, T_true)
    found = register(there, here, np.eye(4), SETTINGS)
    assert found is not None
    assert np.linalg.norm(found.T_target_source[:3, 3] - T_true[:3, 3]) < 0.02
    assert found.inliers > 0.9 and found.error < 0.03 and found.held > 2 * SETTINGS.held


def test_without_points_nothing_is_registered() -> None:
    some = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    none, many = (Submap.of([own], np.eye(4)[None], np.eye(4)) for own in (some[:0], some))
    assert register(none, many, np.eye(4), SETTINGS) is None
    assert register(many, none, np.eye(4), SETTINGS) is None


def test_the_faces_of_a_wall_are_not_the_same_surface() -> None:
    """The same points, but seen from behind: nothing of them fits."""
    room = ring(5, 4)
    x, y = room.way[1]
    seen = scanned(room, [(x - 2, y), (x, y), (x, y + 2)], 0)
    behind = Submap(seen.points, 2 * seen.points - seen.seen_from)
    same, other = (register(seen, own, np.eye(4), SETTINGS) for own in (seen, behind))
    assert same is not None and same.inliers > 0.99
    assert other is None or other.inliers < 0.3


def test_along_a_bare_corridor_a_registration_holds_nothing() -> None:
    walls = ring(5, 4)
    bare = np.concatenate([_wall(1.0), _wall(-1.0), walls.triangles[np.ptp(walls.triangles[:, :, 2], axis=1) == 0]])
    building = replace(walls, triangles=bare)
    there, here = (scanned(building, [(-1.0, 0.0), (1.0, 0.1)], seed) for seed in (0, 1))
    found = register(there, here, np.eye(4), SETTINGS)
    assert found is not None and found.held < SETTINGS.held
    assert found.covariance[3, 3] > 1.5 * found.covariance[4, 4], "it knows less along the corridor"


def _wall(y: float) -> Array:
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


def drifted(truth: Array, keyframes: list[KeyframeNode], slip: tuple[float, float]) -> list[KeyframeNode]:
    """The same keyframes where an odometry has them that slips by (rad, share) a step."""
    T, poses = np.eye(4), [np.eye(4)]
    for step in inverse(truth[:-1]) @ truth[1:]:
        T = T @ (step @ pose(slip[1] * np.linalg.norm(step[:3, 3]), 0.0, 0.0, slip[0]))
        poses.append(T)
    return [replace(k, T_map_sensor=T, T_track_sensor=T) for k, T in zip(keyframes, poses, strict=True)]


def closed(building: str, slip: tuple[float, float]) -> tuple[Array, LoopCloser]:
    """After looks at a growing map, which is not optimised."""
    truth, keyframes, clouds = looked_at(building)
    keyframes = drifted(truth, keyframes, slip)
    walls = WallMap(SurfaceSettings())
    walls.level_by(pose(0.0, 0.0, 0.8, 0.0))
    closer = LoopCloser(SETTINGS)
    for count in range(6, len(keyframes) + 6, 6):
        closer.look(keyframes[:count], 0, walls, clouds)
    return truth, closer


def errors(truth: Array, closures: list[Closure]) -> list[float]:
    return [
        float(np.linalg.norm((inverse(inverse(truth[c.earlier]) @ truth[c.later]) @ c.T_earlier_later)[:3, 3]))
        for c in closures
    ]


@pytest.mark.parametrize("slip", [(0.0, 0.001), (0.0005, 0.01)])
def test_a_ring_is_closed_where_it_was_begun(slip: tuple[float, float]) -> None:
    truth, closer = closed("ring", slip)
    assert closer.closures, "it came back to where it began"
    assert max(errors(truth, closer.closures)) < 0.1
    much = [c for c in closer.closures if c.correction > SETTINGS.alone]
    assert not much or len(closer.closures) >= SETTINGS.together


def test_no_loop_is_closed_along_equal_offices() -> None:
    _, closer = closed("corridor", (0.0005, 0.02))
    assert not closer.closures


def test_its_memory_can_be_kept() -> None:
    closer = LoopCloser(SETTINGS)
    closer.withdrawn = [(closure(0, 9, np.eye(4)), "for a test")]
    other = LoopCloser(SETTINGS)
    other.restore(closer.state())
    assert other.withdrawn == closer.withdrawn and other.state().keys() == closer.state().keys()


def closure(earlier: int, later: int, T: Array) -> Closure:
    return Closure(earlier, later, T, np.diag([1e-5] * 3 + [4e-4] * 3), 1.0, 0.0, "position", "for a test")


def back_end(count: int) -> Backend:
    """There and back with steps that are 5 % too long: the last keyframe is at the first."""
    backend = Backend(Config())
    there = np.array([pose(x, 0.0, 0.0, 0.0) for x in [*range(count), *range(count)[::-1]]])
    for i, T in enumerate(there):
        slipped = pose(T[0, 3] * (1.0 if i < count else 1.05), 0.0, 0.0, 0.0)
        backend.add_keyframe(KeyframeNode(i, i, slipped, slipped))
    return backend


def test_a_closure_is_a_factor_with_its_reason_that_pulls_the_map_together() -> None:
    backend = back_end(10)
    last = len(backend.keyframes) - 1
    backend.closures = [closure(9, last, pose(-9.0, 0.0, 0.0, 0.0))]
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
    right = [closure(k, last - k, np.eye(4)) for k in range(4)]
    backend.closures += [*right, closure(0, last - 1, pose(-3.0, 0.0, 0.0, 0.0))]
    backend.optimise([], [], [], None, steps=20)
    gone = closer.contradicted(backend.keyframes)
    assert [c.T_earlier_later[0, 3] for c, _ in gone] == [-3.0] and backend.closures == right


def test_walls_are_parted_across_two_passes_only() -> None:
    walls = WallMap(SurfaceSettings())
    plane, ends = np.array([1.0, 0, 0, 0]), np.zeros((2, 3))
    for keyframe, wall in ((0, 7), (1, 8), (9, 7), (9, 9)):
        walls.seen.append(SeenWall(keyframe, wall, plane, ends, (0.0, 2.0), 0.01, 0.01))
    walls.part({9}, {0, 1})
    first, second, again, alone = (s.wall for s in walls.seen)
    assert (first, second, alone) == (7, 8, 9) and again not in (7, 8, 9)


@pytest.mark.parametrize("bad", [np.eye(5), np.full((6, 6), np.nan), -np.eye(6), np.triu(np.ones((6, 6)))])
def test_a_covariance_that_is_none_is_refused(bad: Array) -> None:
    with pytest.raises(ValueError, match="covariance"):
        factors.noise_of_covariance(bad)


def test_a_covariance_whitens() -> None:
    noise = factors.noise_of_covariance(np.diag([0.01**2] * 3 + [0.1**2] * 3), 3.0)
    factor = gtsam.BetweenFactorPose3(0, 1, gtsam.Pose3(), noise)
    values = gtsam.Values()
    values.insert(0, gtsam.Pose3())
    values.insert(1, gtsam.Pose3(gtsam.Rot3(), np.array([0.2, 0.0, 0.0])))
    assert factor.error(values) == pytest.approx(2.0, rel=1e-6)  # two sigma, below the robust threshold


def room_planes(width: float, depth: float, at: tuple[float, float], yaw: float) -> Array:
    """(4, 4) the inward planes of a room's four walls, seen from a place in it, turned by `yaw`."""
    n = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    d = np.array([at[0], width - at[0], at[1], depth - at[1]])
    return np.column_stack([n @ pose(0, 0, 0, yaw)[:3, :3].T, d])


def test_a_room_is_alike_wherever_the_sensor_stands_and_however_it_is_turned() -> None:
    poses = np.array([pose(9, 9, 0, -0.8), pose(0, 0, 0, 0.0), pose(3, 1, 0, 0.0), pose(5, 5, 0, 0.0)])
    here = Widths.of(0, room_planes(3.2, 5.1, (1.0, 2.0), 0.8)).turned(poses)
    known = [Widths.of(1, room_planes(3.2, 5.1, (2.5, 4.0), 0.0)), Widths.of(2, room_planes(3.2, 4.4, (1.0, 2.0), 0.0))]
    corridor = Widths.of(3, room_planes(3.2, 5.1, (1.0, 2.0), 0.0)[:2])
    assert similar(here, Widths.together([*known, corridor]).turned(poses)).tolist() == [1]
    assert len(similar(corridor.turned(poses), corridor.turned(poses))) == 0, "its width alone tells no corridor"
    assert len(similar(here, Widths.together([]))) == 0


def test_what_is_alike_may_be_farther_off() -> None:
    way = there_and_back(30)
    way[31:] += [0.0, 6.0]  # an odometry that slipped aside where it turned
    everywhere, none = np.ones(len(way), bool), Ties(np.empty((0, 2), dtype=np.int64))
    told = len(way) - 1, way, way_driven(way), everywhere, none, SETTINGS
    assert passes_near(*told) == []
    found = passes_near(*told, {"walls": np.array([1, 2]), "room": np.empty(0, np.int64)})
    assert [p.by for p in found] == ["walls"] and 2 in found[0].keyframes
