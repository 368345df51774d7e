"""One floor in its plan: when the matcher is asked, whose answers are believed, and when its place is kept."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import pytest
from anchored_maps import Anchored, ground

from data import SceneGraph
from data.scene_graph.motion import moved
from matching import Matcher, MatchResult

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


def lost(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    """Metres off."""
    yaw, x, y = answer.T_a_s or (0.0, 0.0, 0.0)
    return replace(answer, T_a_s=(yaw, x + 2.3, y - 1.4))


def planned_only(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    return replace(answer, wall_surfaces=tuple(p for p in answer.wall_surfaces if p[1] in a.surface_by_id))


def at_the_copy(answer: MatchResult, s: SceneGraph, a: SceneGraph) -> MatchResult:
    yaw, x, y = (np.array(answer.T_a_s) + STEP).tolist()
    walls, rooms = (tuple((i, f"{j}'", c) for i, j, c in own) for own in (answer.wall_surfaces, answer.rooms))
    return replace(answer, T_a_s=(yaw, x, y), wall_surfaces=walls, rooms=rooms)


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
    assert anchors is not None and np.array_equal(anchors.T_map_bim, own.T_map_local) == kept
    assert anchors.T_map_bim[2, 3] == pytest.approx(true[2, 3], abs=0.03)


def test_wrong_rooms_in_a_match_are_outvoted() -> None:
    rooms = []
    for matcher in (None, Changed([muddled])):
        own = Anchored(matcher=matcher)
        anchors = own.update()
        assert anchors is not None and own.T_map_local is not None
        np.testing.assert_allclose(anchors.T_map_bim, own.T_map_local, atol=0.02)
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


@pytest.mark.parametrize(("lacking", "replaced"), [(False, True), (True, False)])
def test_an_answer_elsewhere_replaces_the_committed_one_unless_it_explains_clearly_fewer_walls(
    lacking: bool, replaced: bool
) -> None:
    """The plan has a copy of the building, which explains the map as well; or the building lacks every fourth wall."""
    plan = ground()
    asked = replace(plan, wall_surfaces=tuple(w for n, w in enumerate(plan.wall_surfaces) if n % 4 or not lacking))
    copied = moved(plan, STEP)
    rooms = tuple(replace(r, id=f"{r.id}'") for r in copied.rooms)
    walls = tuple(replace(w, id=f"{w.id}'", room=w.room and f"{w.room}'") for w in copied.wall_surfaces)
    both = replace(asked, rooms=asked.rooms + rooms, wall_surfaces=asked.wall_surfaces + walls, doors=())
    own = Anchored(both, matcher=Changed([at_the_copy, as_it_is], asked))
    true, own.T_map_local = own.T_map_local, None
    first = own.update()
    assert first is not None and true is not None and np.linalg.norm((first.T_map_bim - true)[:2, 3]) > 30.0
    own.T_map_local = first.T_map_bim
    assert own.anchoring.confirm(own.floors, own.T_map_local) is not replaced
    now = own.update()
    assert now is not None and bool(np.linalg.norm((now.T_map_bim - true)[:2, 3]) < 0.05) is replaced
    own.T_map_local = now.T_map_bim
    there, here = ([r for r in own.anchoring.records if r.a_id.endswith("'") is twin] for twin in (True, False))
    assert sum(r.state == "tight" for r in (here if replaced else there)) >= 10
    if replaced:
        assert {r.state for r in there} == {"withdrawn"}
        assert all("places the map elsewhere" in r.events[-1].why for r in there)
    assert all(a_id.endswith("'") is not replaced for _, a_id, _ in own.answer()["wall_surfaces"])
