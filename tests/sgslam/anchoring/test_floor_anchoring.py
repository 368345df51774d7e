"""One floor in its plan: when the matcher is asked, whose answers are believed, and when its place is kept."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import pytest
from anchored_maps import Anchored, ground

from data import SceneGraph
from data.scene_graph.graph import moved
from matching import Matcher, MatchResult
from matching.result import Status
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.plan import Plan
from sgslam.config import AnchorSettings

STEP = np.array([0.0, 40.0, 0.0])  # from the building to its copy


@dataclass
class Changed:
    """The default matcher with a change for each answer, the last one from then on; `plan` takes the place of that
    which it is asked about."""

    changes: list[Callable[[MatchResult, SceneGraph, SceneGraph], MatchResult]]
    plan: SceneGraph | None = None
    asked: int = 0

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.asked += 1
        answer = Matcher.load().match(s, self.plan or a)
        return self.changes[min(self.asked, len(self.changes)) - 1](answer, s, a)


def as_it_is(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    return answer


def forgotten(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    return MatchResult("none", "it was forgotten")


def muddled(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    """The walls of one room are taken for those of another."""
    (s_room, _, c), (_, other, _) = answer.rooms[:2]
    wrong = a.surfaces_of_room[other][0].id
    walls = tuple((x, wrong if s.surface_by_id[x].room == s_room else y, d) for x, y, d in answer.wall_surfaces)
    return replace(answer, rooms=((s_room, other, c), *answer.rooms[1:]), wall_surfaces=walls)


def displaced(answer: MatchResult, by: np.ndarray) -> MatchResult:
    """The best place (3,) is another one."""
    yaw, x, y = (np.array(answer.T_a_s) + by).tolist()
    best = replace(answer.hypotheses[0], T_a_s=(yaw, x, y))
    return replace(answer, T_a_s=(yaw, x, y), hypotheses=(best, *answer.hypotheses[1:]))


def lost(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    """Metres off."""
    return displaced(answer, np.array([0.0, 2.3, -1.4]))


def doubtful(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    """Half as probable."""
    return replace(
        answer, hypotheses=tuple(replace(h, probability=(h.probability or 0) / 2) for h in answer.hypotheses)
    )


def planned_only(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    return replace(answer, wall_surfaces=tuple(p for p in answer.wall_surfaces if p[1] in a.surface_by_id))


def at_the_copy(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    walls, rooms = (tuple((i, f"{j}'", c) for i, j, c in own) for own in (answer.wall_surfaces, answer.rooms))
    return replace(displaced(answer, STEP), wall_surfaces=walls, rooms=rooms)


def test_while_walls_stand_as_planned_the_matcher_is_not_asked_again() -> None:
    own = Anchored()
    assert own.update() is not None
    asked = own.asked
    assert own.update() is not None and own.asked == asked


def test_an_answer_that_the_final_map_does_not_get_again_is_withdrawn() -> None:
    own = Anchored(matcher=Changed([as_it_is, forgotten]))
    own.update()
    assert own.anchoring.committed is not None
    assert not own.anchoring.confirm(own.floors, own.T_map_local) and own.anchoring.committed is None
    assert {record.state for record in own.anchoring.records} == {"withdrawn"}
    assert {record.events[-1].why for record in own.anchoring.records} == {"it was forgotten"}


def test_an_answer_is_as_sure_of_a_wall_as_the_matcher_was_and_of_a_map_cut_again_as_of_the_worst() -> None:
    own = Anchored()
    own.update()
    match = own.anchoring.of(0).committed
    assert match is not None
    given, found = ({(s, a): c for s, a, c in walls} for walls in (match.wall_surfaces, own.answer()["wall_surfaces"]))
    both = given.keys() & found.keys()
    assert len(set(given.values())) > 1 and both and all(found[pair] == given[pair] for pair in both)
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
    assert anchors is not None and np.array_equal(anchors.T_map_local, own.T_map_local) == kept
    assert anchors.T_map_local[2, 3] == pytest.approx(true[2, 3], abs=0.03)


def test_wrong_rooms_in_a_match_are_outvoted() -> None:
    rooms = []
    for matcher in (None, Changed([muddled])):
        own = Anchored(matcher=matcher)
        anchors = own.update()
        assert anchors is not None and own.T_map_local is not None
        np.testing.assert_allclose(anchors.T_map_local, own.T_map_local, atol=0.02)
        rooms.append({(s, a) for s, a, _ in own.answer()["rooms"]})
    assert rooms[0] == rooms[1] and len(rooms[0]) >= 3


def test_a_match_that_its_own_walls_contradict_or_that_leaves_a_direction_free_is_rejected() -> None:
    plan = ground()
    along = np.array([w.normal for w in plan.wall_surfaces]) @ plan.wall_surfaces[0].normal
    parallel = tuple(w for w, cosine in zip(plan.wall_surfaces, along, strict=True) if abs(cosine) > 0.9)
    one_way = replace(plan, wall_surfaces=parallel)
    for own in (Anchored(matcher=Changed([lost])), Anchored(one_way, matcher=Changed([planned_only], plan))):
        assert own.update() is None and own.anchoring.committed is None and not own.anchoring.records
        assert own.anchoring.reason == "its walls do not agree on a place"


@pytest.mark.parametrize(("above", "anchored"), [(1e-5, True), (-1e-5, False)])
def test_a_place_is_committed_to_from_a_probability_on(above: float, anchored: bool) -> None:
    own = Anchored()
    own.update()
    probability = own.anchoring.posterior.places[0].probability
    other = Anchored(commit=probability - above)
    assert (other.update() is not None) is (other.anchoring.committed is not None) is anchored


@pytest.mark.parametrize(("above", "kept"), [(0.01, True), (-0.01, False)])
def test_a_place_is_kept_down_to_a_probability(above: float, kept: bool) -> None:
    own = Anchored(matcher=Changed([as_it_is, doubtful]), withdraw=0.5 - above)
    anchors = own.update()
    assert anchors is not None and own.anchoring.posterior.places[0].probability > 0.99
    assert own.anchoring.confirm(own.floors, own.T_map_local) is kept
    assert own.anchoring.posterior.places[0].probability == pytest.approx(0.5, abs=0.005)
    assert {record.state == "withdrawn" for record in own.anchoring.records} == {not kept}


def test_a_plan_that_lacks_rooms_needs_more_evidence() -> None:
    (floor,), plan, found = Anchored().floors.maps, ground(), []
    assert floor.scene is not None
    for partial in (False, True):
        matching = FloorMatching(Plan(plan, partial), Changed([as_it_is]), AnchorSettings())
        matching.ask(floor.scene, last=True)
        found.append(matching.posterior.places[0].probability)
    assert 0.5 < found[1] < found[0] < 1.0


@pytest.mark.parametrize("status", ["ambiguous", "none", "unique"])
def test_a_matcher_without_probabilities_may_be_unsure_of_a_stated_storey(status: Status) -> None:
    """Its hypotheses are no places; of a unique answer on another storey, the storey is what is wrong."""

    def unsure(match: MatchResult, _: SceneGraph, __: SceneGraph) -> MatchResult:
        listed = tuple(replace(own, probability=None, floor="elsewhere") for own in match.hypotheses)
        return replace(match, status=status, reason="as it is", hypotheses=listed, floor="elsewhere")

    (floor,) = Anchored().floors.maps
    assert floor.scene is not None
    matching = FloorMatching(Plan(ground()), Changed([unsure]), AnchorSettings())
    matching.restrict_storeys(["eg"], is_stated=True)
    matching.ask(floor.scene, last=True)
    assert not matching.is_sure and ("check --storey" in matching.reason) is (status == "unique")


def test_an_answer_elsewhere_replaces_the_committed_one() -> None:
    """The plan has a copy of the building, which explains the map as well."""
    plan = ground()
    copied = moved(plan, STEP)
    rooms = tuple(replace(r, id=f"{r.id}'") for r in copied.rooms)
    walls = tuple(replace(w, id=f"{w.id}'", room=w.room and f"{w.room}'") for w in copied.wall_surfaces)
    both = replace(plan, rooms=plan.rooms + rooms, wall_surfaces=plan.wall_surfaces + walls, doors=())
    own = Anchored(both, matcher=Changed([at_the_copy, as_it_is], plan))
    true, own.T_map_local = own.T_map_local, None
    first = own.update()
    assert first is not None and true is not None and np.linalg.norm((first.T_map_local - true)[:2, 3]) > 30.0
    own.T_map_local = first.T_map_local
    assert not own.anchoring.confirm(own.floors, own.T_map_local)
    now = own.update()
    assert now is not None and np.linalg.norm((now.T_map_local - true)[:2, 3]) < 0.05
    own.T_map_local = now.T_map_local
    there, here = ([r for r in own.anchoring.records if r.a_id.endswith("'") is twin] for twin in (True, False))
    assert sum(r.state == "tight" for r in here) >= 10 and {r.state for r in there} == {"withdrawn"}
    assert all("places the map elsewhere" in r.events[-1].why for r in there)
    assert not any(a_id.endswith("'") for _, a_id, _ in own.answer()["wall_surfaces"])
