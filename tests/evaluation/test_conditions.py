"""Conditions of the study on a building of two rooms: sliding doors, and a plan that lacks half of its walls."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from boxes import Array, pose
from plans import a_graph, box

from data import Door
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.conditions import Troubled, leaves_of, with_doors_as_walls, without_half_of_its_walls

ROOMS = a_graph([box(0, 0, 6, 2), box(0, 2.2, 6, 4)])
WIDE, NARROW = Door("wide", ("room0", "room1"), (3.0, 2.1), 1.2), Door("at a corner", ("room0", "room1"), (0.5, 2.1))
PLAN = replace(ROOMS, doors=(WIDE, NARROW))


@dataclass(frozen=True)
class Standing:
    """A drive of one scan, from a place and heading, whose rays end at places in the building (N, 2)."""

    T: Array
    ends: Array
    count: int = 1
    period_s: float = 0.1

    @property
    def truth(self) -> Trajectory:
        return Trajectory(np.array([0, 10**8]), np.stack([self.T, self.T]))

    def scans(self, count: int | None = None, times: bool = True) -> Iterator[Scan]:
        at = np.column_stack([self.ends, np.full(len(self.ends), 1.5), np.ones(len(self.ends))])
        yield Scan(0, 0, (at @ np.linalg.inv(self.T).T)[:, :3])


def seen(x: float, y: float, *ends: tuple[float, float]) -> Array:
    """(N, 2) where rays from a place in the building end when its doors slide."""
    T = pose(x, y, 1.0, yaw=0.6)
    (scan,) = Troubled(Standing(T, np.array(ends)), "sliding doors", leaves=leaves_of(PLAN)).scans()
    return np.asarray((scan.points @ T[:3, :3].T + T[:3, 3])[:, :2])


def test_a_closed_door_is_in_line_with_the_wall_on_either_side() -> None:
    leaves = {leaf.id: leaf for leaf in leaves_of(PLAN)}
    assert len(leaves) == 4
    for door, width in ((WIDE, 1.2), (NARROW, 0.9)):
        sides = [leaf for name, leaf in leaves.items() if name.startswith(door.id)]
        assert [(leaf.room, leaf.length) for leaf in sides] == [("room0", width), ("room1", width)]
        for leaf, y, into in zip(sides, (2.0, 2.2), (-1.0, 1.0), strict=True):
            assert leaf.centroid == pytest.approx((door.centroid[0], y)) and leaf.normal == pytest.approx((0.0, into))
    closed = with_doors_as_walls(PLAN)
    assert not closed.doors and closed.wall_surfaces == (*PLAN.wall_surfaces, *leaves_of(PLAN))


@pytest.mark.parametrize(("y", "closed"), [(0.45, True), (0.75, False)])
def test_a_door_is_closed_up_to_where_the_sensor_comes_near(y: float, closed: bool) -> None:
    """A door and a half from it; what is beside the doorway, and on this side of it, is seen from afar too."""
    ends = [(3.0, 6.0), (3.3, 4.0), (4.0, 2.0), (3.0, 1.5)]
    found = seen(3.0, y, *ends)
    assert np.allclose(found[2:], ends[2:])
    on_leaf = np.isclose(found[:2, 1], 2.0) & (np.abs(found[:2, 0] - 3.0) < 0.6)
    assert on_leaf.all() if closed else np.allclose(found, ends)


def test_a_door_hides_what_its_width_covers() -> None:
    ends = [(3.0 + 2 * aside, 4.0) for aside in (-0.65, -0.55, 0.55, 0.65)]  # it is met halfway
    assert (seen(3.0, 0.0, *ends)[:, 1] < 2.01).tolist() == [False, True, True, False]


def test_a_plan_lacks_half_of_its_walls_by_chance() -> None:
    plan = a_graph([box(10.0 * k, 0, 6, 4) for k in range(100)])
    some = [without_half_of_its_walls(plan, seed) for seed in (0, 0, 1)]
    assert some[0] == some[1] != some[2] and some[0].rooms == plan.rooms
    for own in some:
        assert 150 < len(own.wall_surfaces) < 250 and set(own.wall_surfaces) < set(plan.wall_surfaces)
