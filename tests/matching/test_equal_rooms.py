"""A long row of equal rooms, which only doors tell apart: however many there are, none may be passed over."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from data.generation.buildings import generate_plan
from data.generation.plan_mesh import write_plan_mesh
from data.geometry import se2
from data.plans.mesh_plan import read_mesh
from data.scene_graph import Door, Room, SceneGraph, WallSurface
from matching import Matcher

WIDE, DEEP, APART = 4.3, 7.7, 4.4
OWN = np.array([0.7, 3.0, -2.0])  # T_s_a


def row(rooms: list[int], doors: list[int], T: NDArray[np.float64]) -> SceneGraph:
    """Rooms by their places in the row, doors by the rooms that lie before them."""

    def at(x: float, y: float) -> tuple[float, float]:
        x, y = se2.apply(T, np.array([x, y])).tolist()
        return x, y

    def turned(x: float, y: float) -> tuple[float, float]:
        x, y = se2.rotate(T[0], np.array([x, y])).tolist()
        return x, y

    walls = []
    for k in rooms:
        x, y = APART * k, 0.0
        sides = (
            (x - WIDE / 2, y, 1.0, 0.0), (x + WIDE / 2, y, -1.0, 0.0),
            (x, y - DEEP / 2, 0.0, 1.0), (x, y + DEEP / 2, 0.0, -1.0),
        )  # fmt: skip
        walls += [
            WallSurface(f"w{k}.{n}", f"r{k}", at(cx, cy), turned(nx, ny), DEEP if nx else WIDE)
            for n, (cx, cy, nx, ny) in enumerate(sides)
        ]
    return SceneGraph(
        "bim", tuple(Room(f"r{k}", at(APART * k, 0.0)) for k in rooms), tuple(walls),
        tuple(Door(f"d{k}", (f"r{k}", f"r{k + 1}"), at(APART * (k + 0.5), 3.1)) for k in doors if k in rooms),
    )  # fmt: skip


@pytest.mark.parametrize("rooms", [8, 24, 60])
@pytest.mark.parametrize("seen", [1, 6, 11, 16])
def test_both_places_of_a_door_are_reported_however_long_the_row(rooms: int, seen: int) -> None:
    seen %= rooms - 3
    other = (seen + rooms // 2) % (rooms - 2)
    plan = row(list(range(rooms)), [seen, other], np.zeros(3))
    answer = Matcher.load("learned").match(row([seen, seen + 1], [seen], OWN), plan)
    assert answer.status == "ambiguous"
    assert {dict(h.rooms)[f"r{seen}"] for h in answer.hypotheses[:2]} == {f"r{seen}", f"r{other}"}


def test_a_place_that_the_network_does_not_propose_is_found_by_its_corners(tmp_path: Path) -> None:
    """A map of a run in a corridor with four of its equal rooms; the network alone named other rooms, 12 m away."""
    write_plan_mesh(generate_plan("l_shape", 2).graph, tmp_path / "plan.stl")
    seen = SceneGraph.load(Path(__file__).with_name("corridor_of_equal_rooms.json"))
    answer = Matcher.load("learned").match(seen, read_mesh(tmp_path / "plan.stl").graph)
    assert answer.status == "unique"
    assert answer.T_a_s == pytest.approx((0.860, 32.17, 41.98), abs=0.05)
