"""A long row of equal rooms, which only doors tell apart: however many there are, none may be passed over."""

from dataclasses import replace
from pathlib import Path

import pytest
from methods import matcher
from plans import a_graph, box, moved

from data import Door, SceneGraph
from data.generation.buildings import generate_plan
from data.generation.level_building import write_plan_mesh
from data.plans.mesh_plan import read_mesh

WIDE, DEEP, APART = 4.3, 7.7, 4.4


@pytest.mark.parametrize("rooms", [8, 24, 60])
@pytest.mark.parametrize("seen", [1, 6, 11, 16])
def test_both_places_of_a_door_are_reported_however_long_the_row(rooms: int, seen: int) -> None:
    seen %= rooms - 3
    other = (seen + rooms // 2) % (rooms - 2)
    row = a_graph([box(APART * k - WIDE / 2, -DEEP / 2, WIDE, DEEP) for k in range(rooms)])
    row = replace(row, rooms=tuple(replace(r, polygon=None) for r in row.rooms))
    doors = {k: Door(f"d{k}", (f"room{k}", f"room{k + 1}"), (APART * (k + 0.5), 3.1)) for k in (seen, other)}
    pair = {f"room{seen}", f"room{seen + 1}"}
    s = replace(
        row, rooms=tuple(r for r in row.rooms if r.id in pair), doors=(doors[seen],),
        wall_surfaces=tuple(w for w in row.wall_surfaces if w.room in pair),
    )  # fmt: skip
    plan = replace(row, doors=tuple(doors.values()))
    answer = matcher("voting").match(moved(s, 0.7, 3.0, -2.0), plan)
    assert answer.status == "ambiguous"
    assert {dict(h.rooms)[f"room{seen}"] for h in answer.hypotheses[:2]} == {f"room{seen}", f"room{other}"}


def test_a_map_of_a_run_is_found_among_equal_rooms(tmp_path: Path) -> None:
    """It holds a corridor with four of its equal rooms; others are 12 m away."""
    write_plan_mesh(generate_plan("l_shape", 2).graph, tmp_path / "plan.stl")
    seen = SceneGraph.load(Path(__file__).with_name("corridor_of_equal_rooms.json"))
    answer = matcher("voting").match(seen, read_mesh(tmp_path / "plan.stl").graph)
    assert (answer.hypotheses[0].probability or 0.0) > 0.9
    assert answer.T_a_s == pytest.approx((0.860, 32.17, 41.98), abs=0.05)
