"""Bodies for plans that are drawn flat: walls between their sides, with doors left out, floors and ceilings."""

from dataclasses import replace

import numpy as np
import pytest

from data.plans.bodies import bodies_of, gaps_of, wall_ids
from data.scene_graph import Door, Floor, LevelSurface, Room, SceneGraph, WallSurface

STOREY = Floor("F", "Ground", 5.0)
FRONT = WallSurface("front", "r", (4.0, 1.5), (-1.0, 0.0), 3.0, "F")
BACK = WallSurface("back", None, (4.2, 1.5), (1.0, 0.0), 3.0, "F")
HIGHER = replace(BACK, height=(5.1, 8.0))


def plan(*surfaces: WallSurface, levels: tuple[LevelSurface, ...] = ()) -> SceneGraph:
    return SceneGraph("bim", (Room("r", (2.0, 1.5), "F", "Office"),), surfaces, (), (STOREY,), level_surfaces=levels)


def extents(*surfaces: WallSurface) -> dict[str, list[tuple[float, float]]]:
    """The lowest and highest x, y, z of each wall's body."""
    corners = {own.global_id: own.triangles.reshape(-1, 3) for own in bodies_of(plan(*surfaces))}
    return {name: [*zip(own.min(axis=0), own.max(axis=0), strict=True)] for name, own in corners.items()}


def test_the_other_side_is_the_next_that_faces_away_behind_it() -> None:
    """No thicker than a wall, beside it and on its storey; else the wall is a sheet."""
    for centroid, depth in (((4.69, 1.5), 0.345), ((4.71, 1.5), 0.05), ((4.2, 4.4), 0.1), ((4.2, 4.6), 0.05)):
        assert extents(FRONT, replace(BACK, centroid=centroid))["front"][0] == pytest.approx((4.0, 4.0 + depth))
    for other in (replace(BACK, normal=(-1.0, 0.0)), replace(BACK, floor="above")):
        assert extents(FRONT, other)["front"][0] == pytest.approx((4.0, 4.05))


@pytest.mark.parametrize(
    ("centroid", "room", "spans"),
    [
        ((4.1, 1.5), "r", [(0.0, 1.0), (2.0, 3.0)]),
        ((4.1, 0.7), "r", [(1.2, 3.0)]),  # what is left beside it is its frame
        ((4.1, 0.9), "r", [(0.0, 0.4), (1.4, 3.0)]),
        ((4.1, 1.5), "above", [(0.0, 3.0)]),  # on another storey
        ((4.1, 3.1), "r", [(0.0, 3.0)]),  # in a wall across
        ((3.4, 1.5), "r", [(0.0, 3.0)]),  # in another wall
    ],
)
def test_bodies_reach_from_both_sides_to_the_middle_of_the_wall_and_leave_its_doors_out(
    centroid: tuple[float, float], room: str, spans: list[tuple[float, float]]
) -> None:
    rooms = (Room("r", (2.0, 1.5), "F"), Room("above", (2.0, 1.5), "up"))
    drawn = SceneGraph("bim", rooms, (FRONT, HIGHER), (Door("d", (room,), centroid, 1.0),), (STOREY,))
    for side, x, z in zip(bodies_of(drawn), ((4.0, 4.1), (4.1, 4.2)), ((5.0, 7.5), (5.1, 8.0)), strict=True):
        boxes = side.triangles.reshape(-1, 36, 3)
        low, high = boxes.min(axis=1), boxes.max(axis=1)
        np.testing.assert_allclose(sorted(zip(low[:, 1], high[:, 1], strict=True)), spans)
        np.testing.assert_allclose([low[0, 0], high[0, 0], low[0, 2], high[0, 2]], [*x, *z])
    assert len(gaps_of(drawn)) == (0 if spans == [(0.0, 3.0)] else 24)  # one in each side


@pytest.mark.parametrize(("frame", "low"), [(0.29, 0.4), (0.31, 0.0)])
def test_openings_and_narrow_frames_beside_them_are_left_out_and_are_gaps(frame: float, low: float) -> None:
    """Along y, from 0 to 3; leftward of this side is -y. What is not full-height is below a window."""
    parts = (("", -1.5, -0.5, False), ("", -0.5, 1.1, True), ("", 1.5 - frame, 1.5, True))
    surface = replace(FRONT, parts=parts)
    assert extents(surface)["front"][1] == pytest.approx((low, 2.0))
    gaps = gaps_of(plan(surface)).reshape(-1, 3)
    assert (gaps[:, 1].min(), gaps[:, 1].max()) == pytest.approx((frame if low == 0.0 else 0.0, 3.0))
    assert gaps[:, 2].max() == pytest.approx(7.5) and not len(gaps_of(plan(FRONT)))
    assert not bodies_of(plan(replace(FRONT, parts=(("", 0.0, 0.0, True),))))  # all of it is a door


def test_sides_of_one_named_wall_are_one_element_and_others_have_their_own() -> None:
    (wall,) = bodies_of(plan(*(replace(side, source="w") for side in (FRONT, BACK))))
    assert (wall.global_id, wall.ifc_class, wall.name, wall.storey) == ("w", "IfcWall", "Office, w", "Ground")
    assert wall.pane and np.ptp(wall.triangles[..., 0]) == pytest.approx(0.2)
    assert [own.global_id for own in bodies_of(plan(FRONT, BACK))] == ["front", "back"]
    split = replace(FRONT, source="w", parts=(("right", -1.5, 0.2, True), ("left", 1.1, 1.5, True)))
    assert [own.global_id for own in bodies_of(plan(split))] == [*wall_ids(split)] == ["right", "left"]


def test_floors_and_ceilings_are_sheets_with_their_holes() -> None:
    square, hole = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)), ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))
    floor = LevelSurface("floor", (0.0, 0.0, 1.0, -5.0), square, (hole,), "r", "F")
    x, y, z, d = (np.array([0.0, 0.1, -1.0, 7.5]) / np.hypot(0.1, 1.0)).tolist()
    ceiling = LevelSurface("ceiling", (x, y, z, d), square, (), "r", "F", "c")
    found = bodies_of(plan(levels=(floor, ceiling, replace(ceiling, id="b", source="b", kind="IfcBeam"))))
    assert [(own.ifc_class, own.pane) for own in found] == [(n, np.inf) for n in ("IfcSlab", "IfcCovering", "IfcBeam")]
    for own, area, height in zip(found, (11.0, 12.0), ((5.0, 5.0), (7.5, 7.8)), strict=False):
        a, b, c = own.triangles[..., :2].transpose(1, 2, 0)
        u, v = b - a, c - a
        assert np.abs(u[0] * v[1] - u[1] * v[0]).sum() / 2 == pytest.approx(area)
        assert (own.triangles[..., 2].min(), own.triangles[..., 2].max()) == pytest.approx(height)
