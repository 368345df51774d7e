"""How a mapped surface lies to other mapped and to planned walls."""

import numpy as np
import pytest

from data.scene_graph import WallSurface
from sgslam.anchoring.wall_association import WallArrays
from sgslam.as_built.mapped_walls import MappedWalls

Wall = tuple[float, float, float, float, float]  # centre x y, normal x y, length


def _surfaces(walls: list[Wall]) -> list[WallSurface]:
    return [WallSurface(f"w{k}", None, (x, y), (nx, ny), length) for k, (x, y, nx, ny, length) in enumerate(walls)]


def _mapped(mapped: list[Wall], planned: list[Wall], tops: list[float]) -> MappedWalls:
    surfaces, n = _surfaces(mapped), len(mapped)
    return MappedWalls(
        surfaces, WallArrays.of(surfaces, {}, np.zeros(2)), WallArrays.of(_surfaces(planned), {}, np.zeros(2)),
        list(range(n)), np.zeros(n), np.array(tops), np.array(tops), np.full(n, 9), set(),
    )  # fmt: skip


FACE: Wall = (0.0, 0.0, 0.0, 1.0, 4.0)  # along x, from -2 to 2, seen from y > 0


@pytest.mark.parametrize(
    ("planned", "free"),
    [
        ([], 4.0),
        ([(-3.0, 0.0, 0.0, 1.0, 4.0), (-3.0, -0.2, 0.0, -1.0, 4.0)], 3.0),  # both faces of one wall that goes on
        ([(0.0, -0.4, 0.0, 1.0, 6.0)], 0.0),  # a wall behind it, which it may be furniture of
        ([(0.0, -1.0, 0.0, 1.0, 6.0)], 4.0),
        ([(0.0, 0.0, 1.0, 0.0, 4.0)], 4.0),  # across it
    ],
)
def test_the_part_without_a_planned_wall_is_unplanned(planned: list[Wall], free: float) -> None:
    stretches = _mapped([FACE], planned, [2.5]).unplanned_stretches(0)
    assert sum(high - low for low, high in stretches) == pytest.approx(free)


def test_what_stands_before_a_taller_wall_is_furniture() -> None:
    behind: Wall = (3.0, -0.4, 0.0, 1.0, 4.0)
    assert _mapped([FACE, behind], [], [1.9, 2.5]).stands_before_another(0)
    assert not _mapped([FACE, behind], [], [1.9, 2.5]).stands_before_another(1)
    assert not _mapped([FACE, behind], [], [1.9, 1.9]).stands_before_another(0)
    assert not _mapped([FACE, (3.0, -0.4, 0.0, -1.0, 4.0)], [], [1.9, 2.5]).stands_before_another(0)


def test_a_wall_between_two_walls_closes_a_room() -> None:
    left, right = (-2.1, 1.0, 1.0, 0.0, 3.0), (2.1, 1.0, -1.0, 0.0, 3.0)
    assert _mapped([FACE], [left, right], [1.5]).closes_a_room(0)
    assert _mapped([FACE, left], [right], [1.5, 2.5]).closes_a_room(0)
    assert not _mapped([FACE], [left], [1.5]).closes_a_room(0)
    assert not _mapped([FACE], [left, right], [1.2]).closes_a_room(0)  # a screen
    assert not _mapped([FACE, left], [right], [1.5, 0.9]).closes_a_room(0)  # ends at a box
