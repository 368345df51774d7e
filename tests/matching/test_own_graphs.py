"""A wrong graph of one's own is refused with the reason; one that is only unusual is matched."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plans import a_graph, box, flat, moved, offices

from data import Door, Room, SceneGraph, UserError, WallSurface
from data.scene_graph import implausible
from data.synthetic_maps.noise_models import draw
from matching import Hypothesis, Matcher, MatchResult
from sgslam.cli.job.inputs import MatcherWithStart

PLAN = a_graph(flat(np.random.default_rng(3)))


def flipped(graph: SceneGraph, count: int) -> SceneGraph:
    """The first walls with their normals turned round."""
    walls = graph.wall_surfaces
    turned = tuple(replace(w, normal=(-w.normal[0], -w.normal[1])) for w in walls[:count])
    return replace(graph, wall_surfaces=(*turned, *walls[count:]))


def scaled(graph: SceneGraph, by: float) -> SceneGraph:
    rooms = tuple(replace(r, centroid=(by * r.centroid[0], by * r.centroid[1]), polygon=None) for r in graph.rooms)
    walls = tuple(
        replace(w, centroid=(by * w.centroid[0], by * w.centroid[1]), length=by * (w.length or 0.0))
        for w in graph.wall_surfaces
    )
    return replace(graph, rooms=rooms, wall_surfaces=walls)


def test_other_units_and_flipped_normals_are_found_and_what_is_unusual_is_not() -> None:
    count, one = len(PLAN.wall_surfaces), a_graph([box(0, 0, 4, 3)])
    core = a_graph([box(-3, -3, 6, 6)]).wall_surfaces  # a corridor around it: its inner walls turn away
    inner = [replace(w, length=1.0, id=f"core/{w.id}/{k}", room="room0") for w in core for k in range(2)]
    around = (*flipped(replace(PLAN, rooms=(Room("room0", (0.0, 0.0)),), wall_surfaces=tuple(inner)), 8).wall_surfaces,)
    outer = a_graph([box(-5, -5, 10, 10)]).wall_surfaces
    ring = SceneGraph("map", (Room("room0", (0.0, 0.0)),), (*outer, *around))
    bare = replace(PLAN, rooms=(), wall_surfaces=tuple(replace(w, room=None) for w in PLAN.wall_surfaces))
    for wrong in (scaled(PLAN, 100.0), scaled(PLAN, 1000.0)):
        assert "millimetres" in (implausible(wrong) or "")
    for wrong in (flipped(PLAN, count), flipped(PLAN, int(0.6 * count)), flipped(one, 3), flipped(ring, 4)):
        assert "normals" in (implausible(wrong) or "")
    in_feet, turned = scaled(PLAN, 1 / 0.3048), flipped(PLAN, int(0.4 * count))
    for usual in (in_feet, turned, flipped(one, 2), ring, flipped(bare, 9), SceneGraph("map")):
        assert implausible(usual) is None


def test_the_matcher_says_which_graph_is_wrong() -> None:
    matcher, s = Matcher.load("voting"), draw(PLAN, "real", np.random.default_rng(1), 5).s_graph
    for wrong, plan, which in (
        (scaled(s, 1000.0), PLAN, "S-graph: "),
        (flipped(s, len(s.wall_surfaces)), PLAN, "S-graph: "),
        (s, scaled(PLAN, 1000.0), "A-graph: "),
    ):
        result = matcher.match(wrong, plan)
        assert result.status == "none" and result.reason.startswith(which)


WALL: dict[str, Any] = {"id": "w", "room": None, "centroid": (0.0, 1.0), "normal": (1.0, 0.0), "length": 2.0}


@pytest.mark.parametrize(
    ("wall", "message"),
    [
        ({"centroid": (0.0, 1.0, 2.0)}, "the centroid of 'w' has 3"),
        ({"normal": (1.0, 0.0, 0.0)}, "the normal of 'w' has 3"),
        ({"normal": (2.0, 0.0)}, "'w' is not a unit vector"),
        ({"length": 0.0}, "'w' has no positive length"),
        ({"length": -2.0}, "'w' has no positive length"),
        ({"id": "r"}, "the id 'r' is given twice"),
        ({"room": "q"}, "'w' refers to a missing room 'q'"),
    ],
)
def test_a_graph_of_the_wrong_form_is_refused_with_the_id(wall: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        SceneGraph("map", (Room("r", (1.0, 1.0)),), (WallSurface(**WALL | wall),))
    flat_point: Any = (1.0, 1.0, 0.0)
    for parts in ({"rooms": (Room("d", flat_point),)}, {"doors": (Door("d", (), flat_point),)}):
        with pytest.raises(UserError, match="the centroid of 'd' has 3 numbers"):
            SceneGraph("map", **parts)


def test_a_motion_has_one_order_in_the_library_and_one_in_the_commands() -> None:
    place = (2.0, 3.0, -4.0)
    for found in (MatchResult("unique", "", T_a_s=place), Hypothesis(1.0, place, None)):
        x, y = np.cos(2.0) * 5 - np.sin(2.0) * 7 + 3, np.sin(2.0) * 5 + np.cos(2.0) * 7 - 4
        assert found.matrix is not None
        np.testing.assert_allclose(found.matrix @ [5, 7, 1.5, 1], [x, y, 1.5, 1])
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    truth = draw(row, "real", np.random.default_rng(2), 4)
    s, (yaw, x, y), matcher = moved(truth.s_graph, 0.0, 0.0, 0.0), truth.T_a_s, Matcher.load("voting")
    for start, placed in (((yaw, x, y), True), ((x, y, yaw), False)):
        assert (matcher.match(s, row, start=start).status == "unique") == placed
        assert (MatcherWithStart(matcher, start).match(s, row).status == "unique") != placed
