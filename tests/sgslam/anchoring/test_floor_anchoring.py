"""One floor in its plan: when the matcher is asked, whose answers are believed, and when its place is kept."""

from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from anchored_maps import Anchored, ground

from data import SceneGraph
from matching import Matcher, MatchResult

STEP = np.array([40.0, 0.0])  # m, from the building to its twin


def test_while_walls_stand_as_planned_the_matcher_is_not_asked_again() -> None:
    own = Anchored()
    assert own.update() is not None
    asked = own.asked
    assert own.update() is not None and own.asked == asked


@dataclass
class ForgetfulMatcher:
    """The default one, which finds no place once it was asked for the first time."""

    asked: int = field(default=0)

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.asked += 1
        return Matcher.load().match(s, a) if self.asked == 1 else MatchResult("none", "it was forgotten")


def test_an_answer_that_the_final_map_does_not_get_again_is_withdrawn() -> None:
    own = Anchored(matcher=ForgetfulMatcher())
    own.update()
    assert own.anchoring.committed is not None
    assert not own.anchoring.confirm(own.floors, own.T_map_local) and own.anchoring.committed is None
    assert own.anchoring.records and all(record.state == "withdrawn" for record in own.anchoring.records)
    assert {record.events[-1].why for record in own.anchoring.records} == {"it was forgotten"}


def confidences(walls: Any) -> dict[tuple[str, str], float]:
    return {(s, a): c for s, a, c in walls}


def test_an_answer_is_as_sure_of_a_wall_as_the_matcher_was_and_of_a_map_cut_again_as_of_the_worst() -> None:
    own = Anchored()
    own.update()
    match = own.anchoring.of(0).committed
    assert match is not None
    given, found = confidences(match.wall_surfaces), confidences(own.answer()["wall_surfaces"])
    assert len(set(given.values())) > 1 and given.keys() & found.keys()
    assert all(found[pair] == given[pair] for pair in given.keys() & found.keys())
    (floor,) = own.floors.maps
    assert floor.scene is not None
    own.floors = copy(own.floors)
    own.floors.maps = [replace(floor, scene=replace(floor.scene))]
    assert {c for _, _, c in own.answer()["wall_surfaces"]} == {min(given.values())}


@pytest.mark.parametrize(("up", "kept"), [(0.0, True), (0.01, True), (0.5, False)])
def test_a_place_that_is_raised_off_the_planned_floor_is_not_kept(up: float, kept: bool) -> None:
    own = Anchored()
    own.update()
    assert own.T_map_local is not None
    true = own.T_map_local.copy()
    own.T_map_local[2, 3] += up
    anchors = own.update(last=False)
    assert anchors is not None
    assert np.array_equal(anchors.T_map_bim, own.T_map_local) == kept
    assert anchors.T_map_bim[2, 3] == pytest.approx(true[2, 3], abs=0.03)


@dataclass(frozen=True)
class MuddledMatcher:
    """Gives the walls of one room to those of another, and is certain of it."""

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        answer = Matcher.load().match(s, a)
        (s_room, _, c), (_, other, _) = answer.rooms[:2]
        wrong = a.surfaces_of_room[other][0].id
        walls = tuple((x, wrong if s.surface_by_id[x].room == s_room else y, d) for x, y, d in answer.wall_surfaces)
        return replace(answer, rooms=((s_room, other, c), *answer.rooms[1:]), wall_surfaces=walls)


def test_wrong_rooms_in_a_match_are_outvoted() -> None:
    right, wrong = Anchored(), Anchored(matcher=MuddledMatcher())
    for own in (right, wrong):
        anchors = own.update()
        assert anchors is not None and own.T_map_local is not None
        np.testing.assert_allclose(anchors.T_map_bim, own.T_map_local, atol=0.02)
    pairs = [{(s, a) for s, a, _ in own.answer()["rooms"]} for own in (right, wrong)]
    assert pairs[0] == pairs[1] and len(pairs[0]) >= 3


@dataclass(frozen=True)
class LostMatcher:
    """Certain of a place that is metres off."""

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        answer = Matcher.load().match(s, a)
        assert answer.T_a_s is not None
        yaw, x, y = answer.T_a_s
        return replace(answer, T_a_s=(yaw, x + 2.3, y - 1.4))


@dataclass(frozen=True)
class OneDirection:
    """Pairs walls with those of a plan that are left of a whole one."""

    whole: SceneGraph

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        answer = Matcher.load().match(s, self.whole)
        return replace(answer, wall_surfaces=tuple(p for p in answer.wall_surfaces if p[1] in a.surface_by_id))


def test_a_match_that_its_own_walls_contradict_or_that_leaves_a_direction_free_is_rejected() -> None:
    plan = ground()
    along = np.array([w.normal for w in plan.wall_surfaces]) @ plan.wall_surfaces[0].normal
    parallel = tuple(w for w, cosine in zip(plan.wall_surfaces, along, strict=True) if abs(cosine) > 0.9)
    for own in (
        Anchored(matcher=LostMatcher()),
        Anchored(replace(plan, wall_surfaces=parallel), matcher=OneDirection(plan)),
    ):
        assert own.update() is None and own.anchoring.committed is None and not own.anchoring.records
        assert own.anchoring.reason == "its walls do not agree on a place"


def with_twin(graph: SceneGraph) -> SceneGraph:
    """The plan with the same building once more, `STEP` away; its ids end in a prime."""

    def there(xy: tuple[float, float]) -> tuple[float, float]:
        return xy[0] + float(STEP[0]), xy[1] + float(STEP[1])

    rooms = (replace(r, id=f"{r.id}'", centroid=there(r.centroid), polygon=None) for r in graph.rooms)
    walls = (
        replace(w, id=f"{w.id}'", room=w.room and f"{w.room}'", centroid=there(w.centroid), plane=None)
        for w in graph.wall_surfaces
    )
    return replace(graph, rooms=(*graph.rooms, *rooms), wall_surfaces=(*graph.wall_surfaces, *walls), doors=())


@dataclass
class ConvertedMatcher:
    """Is certain of the copy, and from its second answer on of the building itself."""

    graph: SceneGraph
    asked: int = 0

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        answer = Matcher.load().match(s, self.graph)
        self.asked += 1
        if self.asked > 1:
            return answer
        assert answer.T_a_s is not None
        yaw, x, y = answer.T_a_s
        primed = tuple((i, f"{j}'", c) for i, j, c in answer.wall_surfaces)
        rooms = tuple((i, f"{j}'", c) for i, j, c in answer.rooms)
        return replace(answer, T_a_s=(yaw, x + STEP[0], y + STEP[1]), wall_surfaces=primed, rooms=rooms)


@pytest.mark.parametrize(("lacking", "replaced"), [(False, True), (True, False)])
def test_an_answer_elsewhere_replaces_the_committed_one_unless_it_explains_clearly_fewer_walls(
    lacking: bool, replaced: bool
) -> None:
    """The copy explains the map as well as the building does; or that lacks every fourth wall in the plan."""
    plan, own = ground(), Anchored()
    asked_for = replace(plan, wall_surfaces=tuple(w for n, w in enumerate(plan.wall_surfaces) if n % 4 or not lacking))
    twins, kept = with_twin(plan), {w.id for w in asked_for.wall_surfaces}
    walls = tuple(w for w in twins.wall_surfaces if w.id in kept or w.id.endswith("'"))
    own = Anchored(replace(twins, wall_surfaces=walls), matcher=ConvertedMatcher(asked_for))
    true, own.T_map_local = own.T_map_local, None
    first = own.update()
    assert first is not None and true is not None
    own.T_map_local = first.T_map_bim
    assert np.linalg.norm((first.T_map_bim - true)[:2, 3]) > 30.0
    assert own.anchoring.confirm(own.floors, own.T_map_local) is not replaced
    now = own.update()
    assert now is not None
    own.T_map_local = now.T_map_bim
    assert bool(np.linalg.norm((now.T_map_bim - true)[:2, 3]) < 0.05) is replaced
    there, here = ([r for r in own.anchoring.records if r.a_id.endswith("'") is twin] for twin in (True, False))
    assert sum(r.state == "tight" for r in (here if replaced else there)) >= 10
    if replaced:
        assert {r.state for r in there} == {"withdrawn"}
        assert all("places the map elsewhere" in r.events[-1].why for r in there)
    assert all(a_id.endswith("'") is not replaced for _, a_id, _ in own.answer()["wall_surfaces"])
