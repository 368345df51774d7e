"""Generated buildings whose walls, doors, windows and columns are elements of their own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely

from data.common.errors import UserError
from data.generation.buildings import generate_plan
from data.generation.wall_building import (
    CLEAR,
    LONGEST,
    StraightWall,
    footprints,
    outline_of,
    squared,
    straight_walls,
    write_wall_building,
)
from data.geometry.areas import Area, difference, united
from data.ifc.graph import read_ifc
from data.plans.elements import PlannedElement, planned_elements
from data.scene_graph import SceneGraph
from evaluation.buildings import building_named

OUTER = 0.3
SEED = 902600


@dataclass(frozen=True)
class Written:
    """A plan, its building's file, and the A-graph of that."""

    plan: SceneGraph
    path: Path
    graph: SceneGraph


@pytest.fixture(scope="module", params=["apartment", "l_shape"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    plan, path = generate_plan(request.param, SEED, plain=True).graph, tmp_path_factory.mktemp("walls") / "building.ifc"
    write_wall_building(plan, path, SEED)
    graph, notices = read_ifc(path)
    assert not notices
    return Written(plan, path, graph)


def areas(path: Path, *classes: str) -> list[Area]:
    """The convex outlines in plan of elements."""
    return [shapely.MultiPoint(of.triangles.reshape(-1, 3)[:, :2]).convex_hull for of in elements(path, *classes)]


def elements(path: Path, *classes: str) -> list[PlannedElement]:
    return [element for element in planned_elements(path) if element.ifc_class in classes]


def test_the_building_has_the_rooms_and_doors_of_its_plan(written: Written) -> None:
    plan, graph = written.plan, written.graph
    areas = [shapely.Polygon(room.polygon) for room in graph.rooms]
    assert len(areas) == len(plan.rooms)
    for room in plan.rooms:
        place = shapely.Polygon(room.polygon).representative_point()
        assert sum(area.contains(place) for area in areas) == 1
    found = np.array([door.centroid for door in graph.doors])
    assert len(found) == len(plan.doors)
    for door in plan.doors:
        k = int(np.hypot(*(found - door.centroid).T).argmin())
        # the plan's outer walls may be thicker than those that are drawn here
        assert np.hypot(*(found[k] - door.centroid)) < (0.01 if len(door.rooms) == 2 else 0.09)
        assert len(graph.doors[k].rooms) == len(door.rooms)


def test_each_wall_is_an_element_that_a_room_sees(written: Written) -> None:
    walls = {element.global_id for element in elements(written.path, "IfcWall")}
    seen = {part[0] for surface in written.graph.wall_surfaces if surface.room for part in surface.parts}
    assert walls and walls <= seen


def test_doors_and_windows_fill_openings_and_panes_face_the_rooms_at_one_depth(written: Written) -> None:
    openings = elements(written.path, "IfcDoor", "IfcWindow")
    heights = {of.ifc_class: (of.triangles[..., 2].min(), of.triangles[..., 2].max()) for of in openings}
    assert heights["IfcDoor"][0] == pytest.approx(0.0) and heights["IfcWindow"][0] > 0.5
    assert all(of.wall and of.filling is not None for of in openings)
    inside = united(shapely.Polygon(room.polygon) for room in written.graph.rooms)
    bodies = [of.filling for of in openings if of.ifc_class == "IfcWindow" and of.filling is not None]
    panes = [shapely.MultiPoint(body.reshape(-1, 3)[:, :2]) for body in bodies]
    assert len(panes) > 4 and [pane.distance(inside) for pane in panes] == pytest.approx([0.12] * len(panes), abs=0.002)


def test_columns_stand_clear_of_openings_and_of_each_other(written: Written) -> None:
    path = written.path
    columns, others = areas(path, "IfcColumn"), areas(path, "IfcDoor", "IfcWindow")
    assert len(columns) >= 2
    for k, column in enumerate(columns):
        assert shapely.distance(column, [*others, *columns[:k]]).min() > CLEAR - 0.01
        # at most the one wall at which it stands is near
        assert sum(wall.distance(column) < CLEAR - 0.01 for wall in areas(path, "IfcWall")) <= 1


def test_the_same_plan_and_seed_give_the_same_bytes(written: Written, tmp_path: Path) -> None:
    write_wall_building(written.plan, tmp_path / "again.ifc", SEED)
    write_wall_building(written.plan, tmp_path / "other.ifc", SEED + 1)
    assert (tmp_path / "again.ifc").read_bytes() == written.path.read_bytes() != (tmp_path / "other.ifc").read_bytes()


def test_a_plan_with_slanted_walls_or_several_storeys_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="storeys"):
        write_wall_building(generate_plan("tower", 0).graph, tmp_path / "tower.ifc", 0)
    with pytest.raises(UserError, match="right angles"):
        write_wall_building(generate_plan("skewed", 0).graph, tmp_path / "skewed.ifc", 0)


@pytest.mark.parametrize("kind", ["apartment", "office", "corridor", "l_shape"])
def test_the_walls_fill_what_lies_between_rooms_once(kind: str) -> None:
    for seed in (902606, 902619, 902627):
        plan = generate_plan(kind, seed, plain=True).graph
        ring = np.array(plan.rooms[0].polygon)
        side = ring[1] - ring[0]
        c, s = side / np.hypot(*side)
        turned = [np.array(room.polygon) @ [[c, -s], [s, c]] for room in plan.rooms]
        rooms = [squared(shapely.Polygon(points)) for points in turned]
        found = footprints(straight_walls(rooms, OUTER), rooms, OUTER)
        between = difference(outline_of(rooms, OUTER), united(rooms))
        assert all(area.geom_type == "Polygon" and not area.interiors for area in found)
        assert sum(area.area for area in found) == pytest.approx(between.area, abs=0.03)
        assert difference(between, united(found)).area < 0.03


def test_a_long_wall_is_built_in_pieces_and_a_shorter_one_at_once() -> None:
    for length, pieces in ((LONGEST - 1.0, 1), (LONGEST + 1.0, 2)):
        half = length / 2
        below = shapely.box(0, 0, length, 2)
        rooms = [below, shapely.box(0, 2.1, half - 0.05, 5), shapely.box(half + 0.05, 2.1, length, 5)]
        walls = straight_walls(rooms, OUTER)
        assert sum((wall.near, wall.far) == (2.0, 2.1) for wall in walls) == pieces
        assert sum(wall.inward == 0 for wall in walls) == pieces + 1


def test_of_two_outer_walls_one_takes_the_corner() -> None:
    walls = straight_walls([shapely.box(0, 0, 4, 3)], OUTER)
    assert len(walls) == 4 and {wall.inward for wall in walls} == {-1, 1}
    assert sum(wall.area.area for wall in walls) == pytest.approx(4.6 * 3.6 - 4 * 3)
    assert united(wall.area for wall in walls).area == pytest.approx(4.6 * 3.6 - 4 * 3)


def test_what_lies_in_the_way_of_a_wall_is_met_but_not_what_lies_beside_it() -> None:
    wall = StraightWall(1, 0.0, 4.0, 1.0, 1.2)
    assert sorted(set(wall.met(0.0, 4.0, [shapely.box(0, 2.0, 3, 2.5)]).tolist())) == [2.0, 2.5]
    assert len(wall.met(0.0, 4.0, [shapely.box(1.2, 2.0, 3, 2.5), shapely.box(0, 4.0, 3, 5)])) == 0


def test_buildings_with_late_seeds_are_for_tests() -> None:
    assert [building_named(f"walls/office_{seed}").role for seed in (901_999, 902_000)] == ["development", "test"]
