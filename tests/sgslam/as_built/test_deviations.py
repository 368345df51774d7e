"""Deviations of planned and mapped wall surfaces, as a view of the verdicts on walls."""

from dataclasses import replace

import numpy as np
import pytest
import two_rooms_seen as rooms
from two_rooms_seen import BOTH, FAR, NEAR, Floats, box, wall_with_door

from data.scene_graph import Floor, SceneGraph, WallSurface
from sgslam.as_built import Deviation


def side(name: str, y: float, x: float, nx: float, ny: float = 0.0) -> WallSurface:
    """Of the wall between the rooms, 2.5 m north or south of its door."""
    return WallSurface(name, None, (x, y), (nx, ny), 2.5, "F", "wall")


NORTH = (side("near", 1.75, NEAR, -1.0), side("far", 1.75, FAR, 1.0))
END, SOUTH = side("end", 3.0, 3.1, 0.0, 1.0), side("south", -1.75, NEAR, -1.0)
PLAN = SceneGraph("bim", (), (*NORTH, END, SOUTH))
SCREEN = box((0.0, -1.5, 0.0), (0.12, 1.5, 2.6))
FACES = tuple(
    WallSurface(name, None, (x, 0.0), (nx, 0.0), 3.0, "m", height=(0.0, 2.6))
    for name, x, nx in (("west", 0.0, -1.0), ("east", 0.12, 1.0))
)


def deviations(
    *built: Floats, matched: tuple[WallSurface, ...] = (), mapped: tuple[WallSurface, ...] = ()
) -> list[Deviation]:
    """Of the two rooms with what is `built` in them; the map has `matched` sides of planned walls, and others."""
    pairs = [(f"s-{side.id}", side.id, 0.9) for side in matched]
    mapped = (*mapped, *(replace(side, id=f"s-{side.id}", floor="m") for side in matched))
    s_graph = SceneGraph("map", (), mapped, floors=(Floor("m", "", 0.0),))
    elements = [own for own in rooms.planned() if own.global_id in ("wall", "shell")]
    views = rooms.views_of(rooms.SHELL, *built, places=BOTH)
    found = rooms.assessed(elements, views, s_graph=s_graph, plan=PLAN, matches={"wall_surfaces": pairs})
    return list(found.deviations)


@pytest.mark.parametrize(("across", "significant"), [(0.0, False), (0.1, True), (-0.1, True)])
def test_both_sides_of_a_moved_wall_are_off_in_opposite_senses(across: float, significant: bool) -> None:
    """Along the normal into the room. An end of the wall says nothing of it, nor does a side that was not matched."""
    found = {own["a_id"]: own for own in deviations(wall_with_door(across=across), matched=(*NORTH, END))}
    assert sorted(found) == ["far", "near"]
    for name, into_room in (("near", -across), ("far", across)):
        own = found[name]
        assert (own["s_id"], own["source"], own["kind"]) == (f"s-{name}", "wall", "moved")
        assert own["significant"] is significant and own["trace"] is None
        assert own["offset_m"] == pytest.approx(into_room, abs=0.01) and 0.0 < (own["sigma_m"] or 0.0) < 0.01
        assert own["tilt_rad"] == pytest.approx(0.0, abs=0.01)


def test_a_mapped_side_is_off_by_its_stretch_of_the_wall() -> None:
    """The wall north of the door stands 10 cm further off than that south of it."""
    built = rooms.WALL + np.where(rooms.WALL[..., 1:2].min(axis=1, keepdims=True) > 0.4, [0.1, 0.0, 0.0], 0.0)
    near, south = deviations(built, matched=(NORTH[0], SOUTH))
    assert (near["offset_m"], south["offset_m"]) == pytest.approx((-0.1, 0.0), abs=0.01)


def test_an_absent_wall_is_absent_on_all_its_sides_and_an_unplanned_one_has_none() -> None:
    found = deviations(SCREEN, mapped=FACES)
    absent, extra = ([own for own in found if own["kind"] == kind] for kind in ("absent", "extra"))
    assert len(found) == len(absent) + len(extra) and all(own["significant"] and own["reason"] for own in found)
    assert {own["a_id"] for own in absent} == {side.id for side in PLAN.wall_surfaces}
    assert {(own["s_id"], own["source"], own["offset_m"]) for own in absent} == {(None, "wall", None)}
    assert {own["s_id"] for own in extra} == {"west", "east"} and {own["a_id"] for own in extra} == {None}
    for own in extra:  # that of the whole wall
        assert own["trace"] is not None
        np.testing.assert_allclose(sorted(own["trace"], key=lambda end: end[1]), [[0.0, -1.5], [0.0, 1.5]], atol=0.15)
    assert [own["kind"] for own in deviations(rooms.WALL, SCREEN, mapped=FACES)] == ["extra"] * 2
