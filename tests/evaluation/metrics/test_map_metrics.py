"""Map metrics: maps whose faults are known, under any motion; the true matches that follow from the place."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from plans import a_graph, box, flat, merged, moved, offices
from scipy.spatial.transform import Rotation

from data import Room, SceneGraph, WallSurface
from data.common.errors import UserError
from data.geometry import se2
from data.synthetic_maps.noise_models import draw
from evaluation.metrics.maps import room_scores, wall_scores
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.metrics.true_matches import true_matches
from sgslam.geometry.frames import se2_to_se3

PLAN = a_graph(offices([3.0, 4.0, 3.5], [5.0, 5.6]), "ground")
T_MAP_BIM = (0.7, 12.0, -5.0)
T_BIM_MAP = se2_to_se3(*se2.inverse(np.array(T_MAP_BIM)).tolist())


def mapped(graph: SceneGraph = PLAN, prefix: str = "s/") -> SceneGraph:
    """A perfect map of a plan: other ids, another frame, another floor."""
    at = moved(graph, *T_MAP_BIM)
    rooms = tuple(dataclasses.replace(r, id=prefix + r.id, floor="map") for r in at.rooms)
    walls = tuple(
        dataclasses.replace(w, id=prefix + w.id, room=w.room and prefix + w.room, floor="map") for w in at.wall_surfaces
    )
    return SceneGraph("map", rooms, walls)


def with_walls(graph: SceneGraph, *walls: WallSurface, without: str | None = None) -> SceneGraph:
    kept = tuple(w for w in graph.wall_surfaces if w.id != without)
    return dataclasses.replace(graph, wall_surfaces=(*kept, *walls))


def piece(wall: WallSurface, name: str, start: float, end: float, **changes: Any) -> WallSurface:
    """The part of a wall between two shares of its length."""
    p, q = (np.array(e) for e in wall.ends())
    x, y = (p + (start + end) / 2 * (q - p)).tolist()
    length = (end - start) * (wall.length or 0.0)
    return dataclasses.replace(wall, id=name, centroid=(x, y), length=length, **changes)


def pushed(wall: WallSurface, metres: float, radians: float = 0.0) -> WallSurface:
    """A wall moved along its normal and turned about its middle."""
    (x, y), (nx, ny) = wall.centroid, wall.normal
    normal = se2.rotate(radians, np.array([nx, ny]))
    return dataclasses.replace(
        wall, centroid=(x + metres * nx, y + metres * ny), normal=(float(normal[0]), float(normal[1]))
    )


def test_a_perfect_map_scores_perfectly() -> None:
    walls, rooms = wall_scores(mapped(), PLAN, T_BIM_MAP), room_scores(mapped(), PLAN, T_BIM_MAP)
    for score in (walls.score, rooms):
        assert score.precision == score.recall == score.f1 == 1
    assert walls.offset_mm is not None and walls.offset_mm.max < 1e-6
    unmeasured = tuple(dataclasses.replace(w, length=None) for w in mapped().wall_surfaces)
    unknown = wall_scores(dataclasses.replace(mapped(), wall_surfaces=unmeasured), PLAN, T_BIM_MAP)
    assert unknown.score == walls.score


def test_scores_do_not_depend_on_where_the_frames_lie() -> None:
    s = draw(PLAN, "real", np.random.default_rng(0), 5)
    T = np.array([2.0, 4e5, -3e6])  # a georeferenced plan
    elsewhere = se2.compose(T, np.array(s.T_a_s))
    before = wall_scores(s.s_graph, PLAN, se2_to_se3(*s.T_a_s))
    after = wall_scores(s.s_graph, moved(PLAN, *T.tolist()), se2_to_se3(*elsewhere.tolist()))
    assert before.score == after.score and before.offset_mm is not None and after.offset_mm is not None
    assert before.offset_mm.rmse == pytest.approx(after.offset_mm.rmse, abs=1e-3)


def test_offsets_are_those_that_were_put_in() -> None:
    rng = np.random.default_rng(0)
    offset, angle = rng.normal(scale=0.02, size=(2, len(PLAN.wall_surfaces))) * [[1], [0.5]] + [[0.03], [0]]
    perfect = mapped()
    walls = tuple(pushed(*w) for w in zip(perfect.wall_surfaces, offset.tolist(), angle.tolist(), strict=True))
    result = wall_scores(dataclasses.replace(perfect, wall_surfaces=walls), PLAN, T_BIM_MAP)
    assert result.score.precision == 1
    assert result.offset_mm is not None and result.offset_mm.max == pytest.approx(1000 * np.abs(offset).max(), abs=1)


@pytest.mark.parametrize(
    ("fault", "kept"), [((0.29, 0), True), ((0.31, 0), False), ((0, 0.17), True), ((0, 0.18), False)]
)
def test_a_wall_beyond_the_limits_is_missed_and_false(fault: tuple[float, float], kept: bool) -> None:
    perfect = mapped(a_graph([box(0, 0, 1.5, 1.5)]))
    wall = perfect.wall_surfaces[0]
    s = with_walls(perfect, pushed(wall, *fault), without=wall.id)
    result = wall_scores(s, a_graph([box(0, 0, 1.5, 1.5)]), T_BIM_MAP)
    assert (result.score.found, result.score.right) == ((4, 4) if kept else (3, 3))


def test_the_other_side_of_a_thin_wall_is_another_wall() -> None:
    two = a_graph([box(0, 0, 3, 3), box(3.08, 0, 3, 3)])
    one = mapped(a_graph([box(0, 0, 3, 3)]))
    result = wall_scores(one, two, T_BIM_MAP)
    assert result.score.precision == 1 and result.score.recall == 0.5


@pytest.mark.parametrize(
    ("parts", "found"), [([(0, 0.3), (0.7, 1)], True), ([(0, 0.3), (0.1, 0.4)], False), ([(0, 0.45)], False)]
)
def test_several_pieces_cover_a_wall_together(parts: list[tuple[float, float]], found: bool) -> None:
    perfect = mapped()
    wall = perfect.wall_surfaces[0]
    s = with_walls(perfect, *(piece(wall, f"p{k}", *p) for k, p in enumerate(parts)), without=wall.id)
    result = wall_scores(s, PLAN, T_BIM_MAP)
    assert (result.score.found == result.score.expected) == found and result.score.precision == 1
    assert true_matches(s, PLAN, T_BIM_MAP).wall_surfaces["p0"] == wall.id.removeprefix("s/")


def test_only_what_could_be_seen_counts() -> None:
    part = SceneGraph("map", mapped().rooms[:2], tuple(w for w in mapped().wall_surfaces if w.room == "s/room0"))
    visible = {w.id for w in PLAN.wall_surfaces if w.room == "room0"}
    assert wall_scores(part, PLAN, T_BIM_MAP, visible).score.recall == 1
    assert wall_scores(part, PLAN, T_BIM_MAP).score.recall == pytest.approx(4 / len(PLAN.wall_surfaces))
    assert wall_scores(part, PLAN, T_BIM_MAP, ()).score.recall is None
    assert wall_scores(part, PLAN, T_BIM_MAP, ()).score.precision == 1  # seen after all, so it is there
    assert room_scores(part, PLAN, T_BIM_MAP, {"room0"}).recall == 1
    with pytest.raises(UserError, match="no wall surface 'room0' in the plan"):
        wall_scores(part, PLAN, T_BIM_MAP, {"room0"})
    with pytest.raises(UserError, match="no room 'hall'"):
        room_scores(part, PLAN, T_BIM_MAP, {"hall"})


def test_nothing_seen_and_nothing_planned() -> None:
    empty = SceneGraph("map")
    for s, a in ((empty, PLAN), (mapped(), empty), (empty, empty)):
        walls, rooms = wall_scores(s, a, T_BIM_MAP), room_scores(s, a, T_BIM_MAP)
        assert walls.score.right == rooms.found == 0 and walls.offset_mm is None
        assert walls.score.precision == (0 if s.wall_surfaces else None)
        assert rooms.recall == (0 if a.rooms else None)


def room_of(polygon: list[tuple[float, float]], name: str) -> Room:
    """A room of the map, given in the plan's frame."""
    return mapped(a_graph([polygon]), name).rooms[0]


def test_a_room_cut_in_two_and_two_in_one() -> None:
    plan = a_graph([box(0, 0, 4, 3), box(4.1, 0, 4, 3), box(8.2, 0, 2, 3)])
    parts = SceneGraph("map", (room_of(box(0, 0, 1.2, 3), "small"), room_of(box(1.2, 0, 2.8, 3), "large")))
    result = room_scores(parts, plan, T_BIM_MAP)
    assert (result.right, result.answered, result.expected) == (1, 2, 3)  # the larger one has 0.7 of the room
    joined = SceneGraph("map", (room_of(box(4.1, 0, 6.1, 3), "both"),))
    assert true_matches(joined, plan, T_BIM_MAP).rooms == {"bothroom0": "room1"}
    assert room_scores(joined, plan, T_BIM_MAP).right == 1  # 12 of 18.3 m2
    outside = SceneGraph("map", (room_of(box(50, 0, 4, 3), "far"),))
    assert room_scores(outside, plan, T_BIM_MAP).precision == 0


@pytest.mark.parametrize(
    ("T", "message"),
    [
        (np.diag([1.0, -1, -1, 1]), "upside down"),
        (np.eye(3), "rigid"),
        (np.diag([1.0, 1, -1, 1]), "rigid"),
        (np.eye(4) * np.nan, "rigid"),
    ],
)
def test_a_tilted_map_frame_is_levelled_and_others_are_refused(T: Any, message: str) -> None:
    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_rotvec([0.2, -0.3, 0.0]).as_matrix()  # the smallest turn that levels the map
    assert wall_scores(mapped(), PLAN, T_BIM_MAP @ tilt).score.f1 == 1
    with pytest.raises(UserError, match=message):
        wall_scores(mapped(), PLAN, T)


def test_storeys_are_not_laid_on_each_other() -> None:
    tower = merged(PLAN, a_graph(offices([3.0, 4.0, 3.5], [5.0, 5.6]), "upper", "upper"))
    for metric in (wall_scores, room_scores, true_matches):
        with pytest.raises(UserError, match=r"2 storeys.*on_floor"):
            metric(mapped(), tower, T_BIM_MAP)
    assert true_matches(mapped(), tower.on_floor("upper"), T_BIM_MAP).floor == "upper"


@pytest.mark.parametrize("seed", range(3))
def test_true_matches_of_noisy_maps_are_those_they_were_drawn_from(seed: int) -> None:
    plan = a_graph(flat(np.random.default_rng(seed)), "ground")
    truth = draw(plan, "real", np.random.default_rng(seed), 6)
    found = true_matches(truth.s_graph, plan, se2_to_se3(*truth.T_a_s))
    agreeing = sum(found.wall_surfaces.get(s) == a for s, a in truth.wall_surfaces.items())
    assert agreeing >= 0.95 * len(truth.wall_surfaces)
    assert found.floor == truth.floor
    assert np.allclose(found.T_a_s, truth.T_a_s)


def test_the_rigid_fit_recovers_a_motion_and_refuses_what_it_cannot_know() -> None:
    plan = moved(PLAN, 0.3, 3e6, 3e6)
    fit = best_rigid_fit(mapped(), plan, {f"s/{w.id}": w.id for w in PLAN.wall_surfaces})
    expected = se2.compose(np.array([0.3, 3e6, 3e6]), se2.inverse(np.array(T_MAP_BIM)))
    assert np.allclose(fit, expected, atol=1e-8, rtol=0)
    corridor = {f"s/{w.id}": w.id for w in PLAN.wall_surfaces if abs(w.normal[0]) < 0.1}
    for matches, message in ((corridor, "parallel"), ({}, "0 true matches"), ({"s/room0/0": "x"}, "surface 'x'")):
        with pytest.raises(UserError, match=message):
            best_rigid_fit(mapped(), PLAN, matches)
