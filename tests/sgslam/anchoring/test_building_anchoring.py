"""All floors of a building share one place: a map on two floors, of equal rooms, and plans of two and three storeys."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from anchored_maps import HIGHER, Anchored, ground, storeys, two_floors

from data import SceneGraph


@pytest.fixture(scope="module")
def base() -> str:
    """The id of the lowest storey."""
    return ground().floors[0].id


def test_a_floor_takes_its_place_from_another_and_from_its_height(base: str) -> None:
    own = Anchored(storeys(0.6), two_floors())
    anchoring = own.anchoring
    assert anchoring.reason == "too little was seen to try a match" and anchoring.committed is None
    one = own.update()
    assert own.storeys == [base, "storey 1"]
    assert not anchoring.of(0).follows and anchoring.of(1).follows
    assert anchoring.committed is anchoring.of(0)
    assert anchoring.of(1).height - anchoring.of(0).height == pytest.approx(HIGHER)
    assert "no other place explains the map nearly as well" in anchoring.reason
    two = own.update(last=False)
    assert one is not None and two is not None
    assert len(two.rooms) > 0 and two.rooms.keys() == one.rooms.keys()
    answer, first = own.answer(), own.answer(0)
    assert answer["floors"] == {"floor-0": base, "floor-1": "storey 1"} and first["floors"] == {"floor-0": base}
    named = [a_id.endswith("storey 1") for _, a_id, _ in answer["wall_surfaces"]]
    assert any(named) and not all(named)
    assert anchoring.confirm(own.floors, own.T_map_local) and own.storeys[1] == "storey 1"
    assert own.floors.maps[0].scene is not None
    anchoring.of(0).withdraw(own.floors.maps[0].scene, "as a test")
    assert anchoring.committed is anchoring.of(1)  # the floor that is left leads


def test_a_floor_waits_until_the_back_end_has_the_place_of_another(base: str) -> None:
    own = Anchored(storeys(0.6), two_floors())
    own.T_map_local = None
    own.update()
    assert own.storeys == [base, None]


@pytest.mark.parametrize(("third", "placed"), [(0.6, True), (0.0, False)])
def test_floors_that_are_ambiguous_alone_are_placed_together(third: float, placed: bool, base: str) -> None:
    """Of four storeys only the third is another, so two equal ones lie one above the other only at the bottom."""
    own = Anchored(storeys(0.0, third, 0.0), two_floors())
    for _ in range(2):
        own.update()
    both = [base, "storey 1"] if placed else [None, None]
    assert own.storeys == both and list(own.answer()["floors"]) == ["floor-0", "floor-1"][: 1 + placed]
    again = deepcopy(own)
    for state in (own, again):  # each floor alone is as ambiguous as before
        assert state.anchoring.confirm(state.floors, state.T_map_local) and state.storeys == both
        state.update()
        assert state.storeys == both


def test_a_single_floor_is_not_placed_by_its_height() -> None:
    own = Anchored(storeys(0.0))
    for _ in range(2):
        own.update()
    assert own.storeys == [None, None]
    assert "storeys explain the map about equally well" in own.anchoring.reason


def test_the_storey_on_which_the_run_begins_decides_between_equal_ones(base: str) -> None:
    for start, height in ((base, 0.0), ("storey 1", HIGHER)):
        own = Anchored(storeys(0.0, 0.0), start=start)
        own.update()
        assert own.storeys == [start, None] and own.anchoring.of(0).height == pytest.approx(height)


@pytest.mark.parametrize("start", ["storey 1", None])
def test_a_given_storey_is_contradicted_where_another_explains_the_map_better(start: str | None, base: str) -> None:
    own = Anchored(storeys(0.6), start=start or base)
    own.update()
    own.anchoring.confirm(own.floors, own.T_map_local)
    assert own.storeys[0] == (None if start else base)
    contradicted = f"storey '{ground().floors[0].name}' of the plan explains the map better"
    assert (contradicted in own.anchoring.reason and "--storey" in own.anchoring.reason) is bool(start)


def test_where_heights_fit_no_storeys_each_floor_needs_an_answer(base: str) -> None:
    own = Anchored(storeys(0.6), two_floors(apart=1.5))
    own.update()
    assert own.storeys == [base] * 2 and not own.anchoring.of(1).follows


def cut(walls: int) -> SceneGraph:
    """Two equal storeys, of the upper of which only so many walls are planned."""
    plan, below = storeys(0.0), ground().wall_surfaces
    return replace(plan, wall_surfaces=plan.wall_surfaces[: len(below) + walls])


@pytest.mark.parametrize(("walls", "follows"), [(3, False), (6, True)])
def test_a_floor_follows_where_enough_walls_agree(walls: int, follows: bool, base: str) -> None:
    own = Anchored(cut(walls), two_floors())
    own.update()
    assert own.storeys == [base, "storey 1" if follows else None]


def test_a_floor_that_proves_to_be_elsewhere_is_withdrawn(base: str) -> None:
    own = Anchored(storeys(0.0, 0.0), two_floors(), base)
    own.update()
    assert own.storeys[1] == "storey 1"
    own.floors.maps[1].walls.T_level_map[2, 3] -= HIGHER  # the climb is measured better
    own.update(last=False)
    assert own.storeys[1] == "storey 2"


def test_a_following_floor_is_confirmed_by_its_walls(base: str) -> None:
    own = Anchored(storeys(0.0), two_floors())
    own.update()
    walls = own.floors.maps[1].walls
    off = np.array([0.0, 0.0, 0.0, 2.0])
    walls.planes_in_map = {k: plane + off * k for k, plane in walls.planes_in_map.items()}
    assert not own.anchoring.confirm(own.floors, own.T_map_local)
    assert own.storeys == [base, None]
