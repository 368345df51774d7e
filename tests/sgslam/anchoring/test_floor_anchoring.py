"""One floor in its plan: when the matcher is asked, what an answer says of its walls, and when its place is kept."""

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from boxes import Array
from test_building_anchoring import CONFIG, CountingMatcher, anchoring_of, mapped  # noqa: F401 (a fixture)

from data import SceneGraph
from matching import Matcher, MatchResult
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.mapping import Floors

Mapped = tuple[SceneGraph, Floors, Array]


@dataclass
class ForgetfulMatcher:
    """The default one, which finds no place once it was asked for the first time."""

    asked: int = field(default=0)

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.asked += 1
        return Matcher.load().match(s, a) if self.asked == 1 else MatchResult("none", "it was forgotten")


def test_while_walls_stand_as_planned_the_matcher_is_not_asked_again(mapped: Mapped) -> None:  # noqa: F811
    plan, floors, T_map_local = mapped
    anchoring, matcher = anchoring_of(plan)
    assert anchoring.update(floors, T_map_local, last=True) is not None
    asked = len(matcher.asked)
    assert anchoring.update(floors, T_map_local, last=True) is not None and len(matcher.asked) == asked


def test_an_answer_that_the_final_map_does_not_get_again_is_withdrawn(mapped: Mapped) -> None:  # noqa: F811
    plan, floors, T_map_local = mapped
    anchoring = BuildingAnchoring(plan, ForgetfulMatcher(), CONFIG)
    anchoring.update(floors, T_map_local, last=True)
    assert anchoring.committed is not None
    assert not anchoring.confirm(floors, T_map_local) and anchoring.committed is None
    assert anchoring.records and all(record.state == "withdrawn" for record in anchoring.records)
    assert {record.events[-1].why for record in anchoring.records} == {"it was forgotten"}


def test_an_answer_is_as_sure_of_a_wall_as_the_matcher_was(mapped: Mapped) -> None:  # noqa: F811
    plan, floors, T_map_local = mapped
    anchoring, _ = anchoring_of(plan)
    anchoring.update(floors, T_map_local, last=True)
    match, alignments = anchoring.of(0).committed, anchoring.alignments(floors, T_map_local)
    assert match is not None
    given = {(s, a): c for s, a, c in match.wall_surfaces}
    answer = anchoring.answer(floors, alignments)
    assert answer is not None
    confidences = {(s, a): c for s, a, c in answer["wall_surfaces"]}
    assert len(set(given.values())) > 1 and given.keys() & confidences.keys()
    assert all(confidences[pair] == given[pair] for pair in given.keys() & confidences.keys())


def test_of_a_map_that_was_cut_again_each_wall_is_as_sure_as_the_worst(mapped: Mapped) -> None:  # noqa: F811
    plan, floors, T_map_local = mapped
    anchoring, _ = anchoring_of(plan)
    anchoring.update(floors, T_map_local, last=True)
    again, (floor,) = copy(floors), floors.maps
    assert floor.scene is not None
    again.maps = [replace(floor, scene=replace(floor.scene))]
    answer = anchoring.answer(again, anchoring.alignments(again, T_map_local))
    assert answer is not None
    assert {c for _, _, c in answer["wall_surfaces"]} == {anchoring.of(0).commitment.confidence}


@pytest.mark.parametrize(("up", "kept"), [(0.0, True), (0.01, True), (0.5, False)])
def test_a_place_that_is_raised_off_the_planned_floor_is_not_kept(
    mapped: Mapped,
    up: float,
    kept: bool,  # noqa: F811
) -> None:
    plan, floors, T_map_local = mapped
    anchoring, _ = anchoring_of(plan)
    anchoring.update(floors, T_map_local, last=True)
    raised = T_map_local.copy()
    raised[2, 3] += up
    anchors = anchoring.update(floors, raised, last=False)
    assert anchors is not None
    assert np.array_equal(anchors.T_map_bim, raised) == kept
    assert anchors.T_map_bim[2, 3] == pytest.approx(T_map_local[2, 3], abs=0.03)
