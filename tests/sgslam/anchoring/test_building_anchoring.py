"""All floors of a building share one place: a map on two floors, of equal rooms, and plans of two and three storeys."""

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from boxes import Array
from drives import small_run

from data import SceneGraph, WallSurface
from matching import Matcher, MatchResult
from sgslam.anchoring.building_anchoring import BuildingAnchoring, merged
from sgslam.config import Config
from sgslam.mapping import Anchors, Floors

HIGHER = 3.0  # m
CONFIG = Config()


@dataclass
class CountingMatcher:
    """The default one; `asked` are the numbers of walls of the maps that it got."""

    asked: list[int] = field(default_factory=list)

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.asked.append(len(s.wall_surfaces))
        return Matcher.load().match(s, a)


@pytest.fixture(scope="module")
def mapped() -> tuple[SceneGraph, Floors, Array]:
    """The plan of one storey, a map of it, and T_map_local of the plan in the map."""
    slam, _ = small_run(with_bim=True)
    final, anchoring = slam._map, slam._map.anchoring
    assert anchoring is not None and final.backend.T_map_bim is not None
    return anchoring.a_graph, final.floors, final.backend.T_map_bim


def storeys(ground: SceneGraph, *moved: float) -> SceneGraph:
    """The plan with more storeys above: of the same rooms, with every third wall moved by so many metres."""
    plan = replace(ground, doors=())
    (floor,) = ground.floors
    for number, metres in enumerate(moved, 1):
        up, name = number * HIGHER, f"storey {number}"
        assert floor.elevation is not None
        walls = tuple(raised(w, k, up, name, metres) for k, w in enumerate(ground.wall_surfaces))
        plan = replace(
            plan, floors=(*plan.floors, replace(floor, id=name, name=name, elevation=floor.elevation + up)),
            rooms=plan.rooms + tuple(replace(r, id=r.id + name, floor=name) for r in ground.rooms),
            wall_surfaces=plan.wall_surfaces + walls,
        )  # fmt: skip
    return plan


def raised(wall: WallSurface, number: int, up: float, name: str, moved: float) -> WallSurface:
    x, y = (np.array(wall.centroid) + moved * (number % 3 == 0) * np.array(wall.normal)).tolist()
    height = wall.height and (wall.height[0] + up, wall.height[1] + up)
    room = wall.room and wall.room + name
    return replace(wall, id=wall.id + name, room=room, floor=name, centroid=(x, y), height=height, plane=None)


def two_floors(floors: Floors, apart: float = HIGHER) -> Floors:
    """The same rooms once more, on a floor that is higher by so many metres."""
    both, below = Floors(CONFIG), floors.maps[0]
    walls = copy(below.walls)
    walls.T_level_map = below.walls.T_level_map.copy()
    walls.T_level_map[2, 3] -= apart
    both.maps = [copy(below), replace(below, number=1, walls=walls)]
    return both


def anchoring_of(plan: SceneGraph, start: str | None = None) -> tuple[BuildingAnchoring, CountingMatcher]:
    matcher = CountingMatcher()
    return BuildingAnchoring(plan, matcher, CONFIG, start), matcher


def storeys_of(anchoring: BuildingAnchoring) -> list[str | None]:
    committed = [anchoring.of(number).committed for number in (0, 1)]
    return [None if match is None else match.floor for match in committed]


def test_a_floor_takes_its_place_from_another_and_from_its_height(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.6))
    assert anchoring.reason == "too little was seen to try a match" and anchoring.committed is None
    assert not anchoring.awaits_confirmation
    one = anchoring.update(both, T_map_local, last=True)
    assert storeys_of(anchoring) == [ground.floors[0].id, "storey 1"]
    assert not anchoring.of(0).commitment.follows and anchoring.of(1).commitment.follows
    assert anchoring.committed is anchoring.of(0)
    assert anchoring.of(1).height - anchoring.of(0).height == pytest.approx(HIGHER)
    assert "no other place explains the map nearly as well" in anchoring.reason
    two = anchoring.update(both, T_map_local, last=False)
    assert one is not None and two is not None
    assert len(two.rooms) > 0 and two.rooms.keys() == one.rooms.keys()
    assert anchoring.confirm(both, T_map_local) and storeys_of(anchoring)[1] == "storey 1"


def test_a_floor_waits_until_the_back_end_has_the_place_of_another(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, _ = mapped
    anchoring, _ = anchoring_of(storeys(ground, 0.6))
    anchoring.update(two_floors(floors), None, last=True)
    assert storeys_of(anchoring) == [ground.floors[0].id, None]


def test_an_answer_has_the_walls_and_rooms_of_all_floors(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.6))
    anchoring.update(both, T_map_local, last=True)
    alignments = anchoring.alignments(both, T_map_local)
    answer = anchoring.answer(both, alignments)
    assert answer is not None and answer["floors"] == {"floor-0": ground.floors[0].id, "floor-1": "storey 1"}
    named = [a_id.endswith("storey 1") for _, a_id, _ in answer["wall_surfaces"]]
    assert any(named) and not all(named)
    first = anchoring.answer(both, {0: alignments[0]})
    assert first is not None and first["floors"] == {"floor-0": ground.floors[0].id}


def test_an_answer_that_is_not_sure_is_that_of_the_first_floor(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.0, 0.0))
    anchoring.update(both, T_map_local, last=True)
    answer = anchoring.answer(both, {})
    assert answer is not None and answer["status"] == "ambiguous" and list(answer["floors"]) == ["floor-0"]


def test_the_floor_that_is_left_leads(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.6))
    anchoring.update(both, T_map_local, last=True)
    assert both.maps[0].scene is not None
    anchoring.of(0).withdraw(both.maps[0].scene, "as a test")
    assert anchoring.committed is anchoring.of(1)


def test_the_height_of_a_building_is_as_uncertain_as_that_of_the_worst_floor() -> None:
    below, above = (Anchors(np.eye(4), {}, {}, {}, sigma_height=sigma) for sigma in (0.1, 0.3))
    assert merged([below, above]).sigma_height == merged([above, below]).sigma_height == 0.3


def test_floors_that_are_ambiguous_alone_are_placed_together(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    """The lower two storeys are equal, and the third is another: the floors are the lower two."""
    ground, floors, T_map_local = mapped
    both, (anchoring, matcher) = two_floors(floors), anchoring_of(storeys(ground, 0.0, 0.6))
    anchoring.update(both, T_map_local, last=True)
    asked = len(matcher.asked)
    assert storeys_of(anchoring)[0] is None and asked > 2
    anchoring.update(both, T_map_local, last=True)
    assert storeys_of(anchoring) == [ground.floors[0].id, "storey 1"]


@pytest.mark.parametrize(("walls", "joint"), [(20, 0), (19, 0), (18, 4)])
def test_floors_are_matched_together_again_when_they_have_grown(
    mapped: tuple[SceneGraph, Floors, Array], walls: int, joint: int
) -> None:
    """From so many walls on each of two floors to twenty; each floor is also asked for alone."""
    ground, floors, T_map_local = mapped
    (anchoring, matcher), small, whole = anchoring_of(storeys(ground, 0.0, 0.0)), two_floors(floors), two_floors(floors)
    for floor in small.maps:
        assert floor.scene is not None and len(floor.scene.graph.wall_surfaces) == 20
        floor.scene = replace(
            floor.scene, graph=replace(floor.scene.graph, wall_surfaces=floor.scene.graph.wall_surfaces[:walls])
        )
    anchoring.update(small, T_map_local, last=True)
    asked = len(matcher.asked)
    assert asked == 2 + 4  # two floors, each with two storeys
    anchoring.update(whole, T_map_local, last=True)
    assert len(matcher.asked) - asked == 2 + joint


def test_a_single_floor_is_not_placed_by_its_height(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    anchoring, matcher = anchoring_of(storeys(ground, 0.0))
    for _ in range(2):
        anchoring.update(floors, T_map_local, last=True)
    assert storeys_of(anchoring) == [None, None] and len(matcher.asked) <= 2
    assert "storeys explain the map about equally well" in anchoring.reason


def test_the_storey_on_which_the_run_begins_decides(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    for start in (ground.floors[0].id, "storey 1"):
        anchoring, _ = anchoring_of(storeys(ground, 0.0, 0.0), start)
        anchoring.update(floors, T_map_local, last=True)
        assert storeys_of(anchoring) == [start, None]


def test_where_heights_fit_no_storeys_each_floor_needs_an_answer(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    anchoring, _ = anchoring_of(storeys(ground, 0.6))
    anchoring.update(two_floors(floors, apart=1.5), T_map_local, last=True)
    assert storeys_of(anchoring) == [ground.floors[0].id] * 2
    assert not anchoring.of(1).commitment.follows


@pytest.mark.parametrize(("walls", "follows"), [(3, False), (6, True)])
def test_a_floor_follows_where_enough_walls_agree(
    mapped: tuple[SceneGraph, Floors, Array], walls: int, follows: bool
) -> None:
    ground, floors, T_map_local = mapped
    plan = storeys(ground, 0.0)
    upper = [wall for wall in plan.wall_surfaces if wall.floor == "storey 1"]
    anchoring, _ = anchoring_of(replace(plan, wall_surfaces=(*ground.wall_surfaces, *upper[:walls])))
    anchoring.update(two_floors(floors), T_map_local, last=True)
    assert storeys_of(anchoring) == [ground.floors[0].id, "storey 1" if follows else None]


def test_a_floor_that_proves_to_be_elsewhere_is_withdrawn(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.0, 0.0), ground.floors[0].id)
    anchoring.update(both, T_map_local, last=True)
    assert storeys_of(anchoring)[1] == "storey 1"
    both.maps[1].walls.T_level_map[2, 3] -= HIGHER  # the climb is measured better
    anchoring.update(both, T_map_local, last=False)
    assert storeys_of(anchoring)[1] == "storey 2"


def test_a_following_floor_is_confirmed_by_its_walls(mapped: tuple[SceneGraph, Floors, Array]) -> None:
    ground, floors, T_map_local = mapped
    both, (anchoring, _) = two_floors(floors), anchoring_of(storeys(ground, 0.0))
    anchoring.update(both, T_map_local, last=True)
    both.maps[1].walls.T_level_map[:2, 3] += 2.0
    assert not anchoring.confirm(both, T_map_local)
    assert storeys_of(anchoring) == [ground.floors[0].id, None]
