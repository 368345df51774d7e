"""A wrong graph of one's own is refused with the reason; one that is only unusual is matched."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plans import SHARED, a_graph, box, flat, moved, offices, swiss

from data import Door, Room, SceneGraph, UserError, WallSurface
from data.generation.buildings import KINDS, generate_plan
from data.scene_graph import implausible
from data.synthetic_maps.noise_models import NOISE_MODELS, draw
from matching import Hypothesis, Matcher, MatchResult
from sgslam.cli.job.inputs import MatcherWithStart

PLAN = a_graph(flat(np.random.default_rng(3)))
ROOM = Room("r", (1.0, 1.0))


def flipped(graph: SceneGraph, count: int) -> SceneGraph:
    """The first walls with their normals turned round."""
    walls = [
        replace(w, normal=(-w.normal[0], -w.normal[1])) if k < count else w for k, w in enumerate(graph.wall_surfaces)
    ]
    return replace(graph, wall_surfaces=tuple(walls))


def scaled(graph: SceneGraph, by: float, lengths: bool = True) -> SceneGraph:
    def at(point: tuple[float, float]) -> tuple[float, float]:
        return by * point[0], by * point[1]

    rooms = tuple(replace(r, centroid=at(r.centroid), polygon=None) for r in graph.rooms)
    walls = tuple(
        replace(w, centroid=at(w.centroid), length=by * (w.length or 0.0) if lengths else None)
        for w in graph.wall_surfaces
    )
    return replace(graph, rooms=rooms, wall_surfaces=walls)


@pytest.mark.parametrize("lengths", [True, False])
def test_other_units_are_told(lengths: bool) -> None:
    assert implausible(scaled(PLAN, 1 / 0.3048, lengths)) is None  # feet look like a large building
    for unit in (100.0, 1000.0):
        assert "millimetres" in (implausible(scaled(PLAN, unit, lengths)) or "")


def test_flipped_normals_are_told_and_a_few_wrong_ones_are_not() -> None:
    count = len(PLAN.wall_surfaces)
    assert f"{count} of {count} walls" in (implausible(flipped(PLAN, count)) or "")
    assert "point out of the room" in (implausible(flipped(PLAN, int(0.6 * count))) or "")
    assert implausible(flipped(PLAN, int(0.4 * count))) is None
    one = a_graph([box(0, 0, 4, 3)])
    assert implausible(flipped(one, 3)) is not None and implausible(flipped(one, 2)) is None
    three = replace(one, wall_surfaces=one.wall_surfaces[:3])
    assert implausible(flipped(three, 3)) is None  # too few to tell


def test_a_corridor_around_a_core_is_not_taken_for_flipped() -> None:
    """Its inner walls turn away from the centroid, and are more than the outer ones."""
    outer = a_graph([box(-5, -5, 10, 10)]).wall_surfaces
    core = [replace(w, length=1.0, id=f"core/{w.id}/{k}") for w in a_graph([box(-3, -3, 6, 6)]).wall_surfaces
            for k in range(2)]  # fmt: skip
    core = list(flipped(SceneGraph("map", (), tuple(replace(w, room=None) for w in core)), 8).wall_surfaces)
    ring = SceneGraph("map", (Room("room0", (0.0, 0.0)),), (*outer, *(replace(w, room="room0") for w in core)))
    assert len(core) > len(outer) and implausible(ring) is None
    assert implausible(flipped(ring, 4)) is not None


@pytest.mark.parametrize("kind", KINDS)
def test_no_drawn_plan_and_no_drawn_map_is_taken_for_wrong(kind: str) -> None:
    for seed in range(2):
        plan = generate_plan(kind, seed).graph
        maps = [draw(plan, noise, np.random.default_rng(seed), n).s_graph for noise in NOISE_MODELS for n in (1, 4)]
        assert [implausible(graph) for graph in (plan, *maps)] == [None] * (1 + len(maps))


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no folder of real plans at {SHARED}")
def test_no_real_plan_is_taken_for_wrong() -> None:
    names = [path.stem for path in (SHARED / "data/floorplans/swiss_floors").glob("*.json")]
    assert names and not [name for name in names if implausible(swiss(name)) is not None]


def test_an_empty_graph_and_one_without_rooms_are_plausible() -> None:
    bare = replace(PLAN, rooms=(), wall_surfaces=tuple(replace(w, room=None) for w in PLAN.wall_surfaces))
    assert implausible(SceneGraph("map")) is None
    assert implausible(flipped(bare, len(bare.wall_surfaces))) is None


def test_the_matcher_says_which_graph_is_wrong_and_what_is() -> None:
    matcher, s = Matcher.load("voting"), draw(PLAN, "real", np.random.default_rng(1), 5).s_graph
    assert matcher.match(s, PLAN).status == "unique"
    for wrong, plan, told in (
        (scaled(s, 1000.0), PLAN, "S-graph: the median wall is"),
        (flipped(s, len(s.wall_surfaces)), PLAN, "S-graph: the normals of"),
        (s, scaled(PLAN, 1000.0), "A-graph: the median wall is"),
    ):
        result = matcher.match(wrong, plan)
        assert result.status == "none" and result.reason.startswith(told)


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ({"rooms": (Room("r", (1.0, 1.0, 0.0)),)}, "the centroid of 'r' has 3 numbers"),  # type: ignore[arg-type]
        ({"doors": (Door("d", ("r",), (1.0, 1.0, 0.0)),)}, "the centroid of 'd' has 3 numbers"),  # type: ignore[arg-type]
        ({"wall_surfaces": (WallSurface("w", None, (0.0, 1.0, 2.0), (1.0, 0.0)),)}, "the centroid of 'w' has 3"),  # type: ignore[arg-type]
        ({"wall_surfaces": (WallSurface("w", None, (0.0, 1.0), (1.0, 0.0, 0.0)),)}, "the normal of 'w' has 3"),  # type: ignore[arg-type]
        ({"wall_surfaces": (WallSurface("w", None, (0.0, 1.0), (2.0, 0.0)),)}, "'w' is not a unit vector"),
        ({"wall_surfaces": (WallSurface("w", None, (0.0, 1.0), (1.0, 0.0), 0.0),)}, "'w' has no positive length"),
        ({"wall_surfaces": (WallSurface("w", None, (0.0, 1.0), (1.0, 0.0), -2.0),)}, "'w' has no positive length"),
        ({"wall_surfaces": (WallSurface("r", None, (0.0, 1.0), (1.0, 0.0)),)}, "the id 'r' is given twice"),
        ({"wall_surfaces": (WallSurface("w", "q", (0.0, 1.0), (1.0, 0.0)),)}, "'w' refers to a missing room 'q'"),
    ],
)
def test_a_graph_of_the_wrong_form_is_refused_with_the_id(parts: dict[str, Any], told: str) -> None:
    with pytest.raises(UserError, match=told):
        SceneGraph("map", **{"rooms": (ROOM,), **parts})
    right = WallSurface("w", "r", (0.0, 1.0), (1.0, 0.0), 0.01)
    assert SceneGraph("map", (ROOM,), (right,), (Door("d", ("r",), (1.0, 1.0)),)).rooms == (ROOM,)


def test_the_matrix_of_a_match_moves_points_as_its_motion_does() -> None:
    place = (2.0, 3.0, -4.0)
    for found in (MatchResult("unique", "", T_a_s=place), Hypothesis(1.0, place, None)):
        assert found.matrix is not None and found.matrix.shape == (4, 4)
        x, y = np.cos(2.0) * 5 - np.sin(2.0) * 7 + 3, np.sin(2.0) * 5 + np.cos(2.0) * 7 - 4
        np.testing.assert_allclose(found.matrix @ [5, 7, 1.5, 1], [x, y, 1.5, 1])
    assert MatchResult("none", "").matrix is None


def test_a_start_is_in_the_order_of_the_motion_and_the_commands_in_its_own() -> None:
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    truth = draw(row, "real", np.random.default_rng(2), 4)
    s, (yaw, x, y) = moved(truth.s_graph, 0.0, 0.0, 0.0), truth.T_a_s
    matcher = Matcher.load("voting")
    for given, placed in (((yaw, x, y), True), ((x, y, yaw), False)):
        assert (matcher.match(s, row, start=given).status == "unique") == placed
    for given, placed in (((x, y, yaw), True), ((yaw, x, y), False)):
        assert (MatcherWithStart(matcher, given).match(s, row).status == "unique") == placed
