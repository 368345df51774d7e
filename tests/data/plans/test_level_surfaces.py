"""Floors and ceilings of a plan: those that are seen, against known models and against rays in generated buildings."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from ifc_models import IfcModel, box

from data import LevelSurface, SceneGraph, UserError
from data.generation.buildings import generate_plan
from data.generation.level_building import write_level_building, write_level_demo
from data.geometry.level_faces import level_faces
from data.geometry.raycast import TriangleScene
from data.ifc.graph import read_ifc
from data.ifc.products import open_ifc, products
from data.ifc.rooms import LEVELS

Body = tuple[str, tuple[float, float, float, float], tuple[float, float]]  # class, lowest and highest x y, z
FLOOR: Body = ("IfcSlab", (-0.3, -0.3, 6.3, 4.3), (-0.2, 0.0))
ROOF: Body = ("IfcSlab", (-0.3, -0.3, 6.3, 4.3), (3.4, 3.6))
Seen = tuple[str, float, float]  # class, z, area


def room_with(folder: Path, *bodies: Body) -> SceneGraph:
    """A room of 6 m x 4 m, whose space reaches from 0 to 2.8, between walls that are 3.4 m high."""
    model = IfcModel("millimetres")
    storey = model.storey("ground", 0.0)
    for area in ((-0.3, -0.3, 6.3, 0), (-0.3, 4, 6.3, 4.3), (-0.3, 0, 0, 4), (6, 0, 6.3, 4)):
        model.prism("IfcWall", box(*area), (0.0, 3.4), storey)
    model.prism("IfcSpace", box(0, 0, 6, 4), (0.0, 2.8), storey, "room")
    for ifc_class, area, z in bodies:
        model.prism(ifc_class, box(*area), z, storey)
    return read_ifc(model.save(folder / "room.ifc"))[0]


def outline(level: LevelSurface) -> shapely.Polygon:
    return shapely.Polygon(level.polygon, level.holes)


def seen(graph: SceneGraph, is_floor: bool) -> list[Seen]:
    """What the room has, by height."""
    (room,) = graph.rooms
    own = [v for v in graph.level_surfaces if v.room == room.id and v.is_floor == is_floor]
    assert all(level.stated == (level.kind != "IfcSpace") for level in own)
    return sorted((v.kind, round(v.height(1.0, 1.0), 4) + 0.0, round(outline(v).area, 2)) for v in own)


@pytest.mark.parametrize(
    ("bodies", "floors", "ceilings"),
    [
        ((FLOOR, ROOF), [("IfcSlab", 0.0, 24.0)], [("IfcSlab", 3.4, 24.0)]),
        # a suspended ceiling over half of the room, and a floor covering under the other half
        (
            (FLOOR, ROOF, ("IfcCovering", (0, 0, 3, 4), (3.25, 3.27)), ("IfcCovering", (3, 0, 6, 4), (0.0, 0.015))),
            [("IfcCovering", 0.015, 12.0), ("IfcSlab", 0.0, 12.0)],
            [("IfcCovering", 3.25, 12.0), ("IfcSlab", 3.4, 12.0)],
        ),
        # a platform; a strip that is too narrow for a level still hides the floor
        (
            (FLOOR, ROOF, ("IfcSlab", (0, 0, 6, 1), (0.0, 0.2)), ("IfcSlab", (0, 3.7, 6, 4), (0.0, 0.2))),
            [("IfcSlab", 0.0, 16.2), ("IfcSlab", 0.2, 6.0)],
            [("IfcSlab", 3.4, 24.0)],
        ),
        # under a shelf or gallery one looks or not, by its height
        (
            (FLOOR, ROOF, ("IfcSlab", (0, 0, 1, 4), (1.25, 1.45))),
            [("IfcSlab", 0.0, 20.0), ("IfcSlab", 1.45, 4.0)],
            [("IfcSlab", 3.4, 24.0)],
        ),
        (
            (FLOOR, ROOF, ("IfcSlab", (0, 0, 1, 4), (1.35, 1.55))),
            [("IfcSlab", 0.0, 24.0), ("IfcSlab", 1.55, 4.0)],
            [("IfcSlab", 1.35, 4.0), ("IfcSlab", 3.4, 24.0)],
        ),
        # without slabs the space tells; a slab over most of the room does instead
        ((), [("IfcSpace", 0.0, 24.0)], [("IfcSpace", 2.8, 24.0)]),
        ((("IfcSlab", (0, 0, 3.1, 4), (-0.2, 0.0)),), [("IfcSlab", 0.0, 12.4)], [("IfcSpace", 2.8, 24.0)]),
        # a stair leads through the ceiling, not through the floor
        ((("IfcStair", (0, 0, 1, 4), (0.0, 2.9)),), [("IfcSpace", 0.0, 24.0)], []),
    ],
    ids=["slabs", "coverings", "platform", "shelf", "gallery", "space", "part of a slab", "stair"],
)
def test_a_room_has_the_floors_and_ceilings_that_one_sees(
    bodies: tuple[Body, ...], floors: list[Seen], ceilings: list[Seen], tmp_path: Path
) -> None:
    graph = room_with(tmp_path, *bodies)
    found = [v for v in seen(graph, True) if v[0] != "IfcStair"]
    assert (found, seen(graph, False)) == (floors, ceilings)


def sloped(degrees: float) -> np.ndarray:
    """(2, 3, 3) a square that rises along x, facing up."""
    z = np.tan(np.radians(degrees))
    a, b, c, d = (0.0, 0.0, 0.0), (1.0, 0.0, z), (1.0, 1.0, z), (0.0, 1.0, 0.0)
    return np.array([(a, b, c), (a, c, d)])


def test_slopes_up_to_fifteen_degrees_are_levels() -> None:
    (face,) = level_faces(sloped(14.5), is_body=False)
    assert face.is_floor and face.area.area == pytest.approx(1.0)
    assert face.plane == pytest.approx((0.0, np.tan(np.radians(14.5)), 0.0))
    assert not list(level_faces(sloped(15.5), is_body=False))


def hits(path: Path, graph: SceneGraph) -> tuple[int, int]:
    """How many of the rays up and down from points in the rooms end on a level surface, and how many there are."""
    scene = TriangleScene(np.concatenate([p.vertices[p.faces] for p in products(open_ifc(path), LEVELS)]))
    right, rays, rng = 0, 0, np.random.default_rng(0)
    for room in graph.rooms:
        inside = shapely.Polygon(room.polygon).buffer(-0.1)
        low, high = np.reshape(inside.bounds, (2, 2))
        xy = rng.uniform(low, high, (60, 2))
        xy = xy[shapely.contains_xy(inside, *xy.T)]
        for up in (1.0, -1.0):
            eyes = np.column_stack([xy, np.full(len(xy), 1.4)])
            z = 1.4 + up * scene.distances(eyes, np.tile([0.0, 0.0, up], (len(xy), 1)))
            own = [v for v in graph.level_surfaces if v.room == room.id and v.is_floor == (up < 0)]
            for (x, y), hit in zip(xy.tolist(), z.tolist(), strict=True):
                over = [v for v in own if shapely.contains_xy(outline(v), x, y)]
                right += any(abs(v.height(x, y) - hit) < 0.002 for v in over)
                rays += 1
    return right, rays


@pytest.mark.parametrize(
    ("kind", "seed", "high"), [("skewed", 4, False), ("l_shape", 4, False), ("apartment", 5, True)]
)
def test_rays_in_a_generated_building_end_on_its_level_surfaces(
    kind: str, seed: int, high: bool, tmp_path: Path
) -> None:
    write_level_building(generate_plan(kind, seed).graph, tmp_path / "b.ifc", seed, high)
    right, rays = hits(tmp_path / "b.ifc", read_ifc(tmp_path / "b.ifc")[0])
    assert rays > 600 and right >= 0.995 * rays


def test_a_flat_plan_has_level_floors_and_no_suspended_ceilings(tmp_path: Path) -> None:
    def levels(flat: bool) -> tuple[set[str], set[float]]:
        write_level_building(generate_plan("l_shape", 4).graph, tmp_path / "plan.ifc", 4, flat=flat)
        found = read_ifc(tmp_path / "plan.ifc")[0].level_surfaces
        return {v.kind for v in found}, {round(v.height(*v.polygon[0]), 3) + 0.0 for v in found if v.is_floor}

    (kinds, floors), (flat_kinds, flat_floors) = levels(False), levels(True)
    assert "IfcCovering" in kinds - flat_kinds and len(floors) > 1 and flat_floors == {0.0}


@pytest.mark.slow
def test_storeys_that_a_stair_joins(tmp_path: Path) -> None:
    write_level_demo(tmp_path / "demo.ifc", 0)
    graph = read_ifc(tmp_path / "demo.ifc")[0]
    ground, upper = (f.id for f in graph.floors)
    lowest = {
        f: min(v.height(*v.polygon[0]) for v in graph.on_floor(f).level_surfaces if v.is_floor) for f in (ground, upper)
    }
    assert lowest == pytest.approx({ground: 0.0, upper: 3.2}, abs=1e-6)
    (landing,) = (v for v in graph.level_surfaces if v.kind == "IfcStair" and v.is_floor)
    assert landing.floor == ground and landing.plane[3] == pytest.approx(-1.6)
    over = [v for v in graph.level_surfaces if outline(v).contains(outline(landing).centroid) and v != landing]
    assert all(v.height(*v.polygon[0]) < 1.7 or not v.is_floor for v in over)  # the upper floor is open over the stair


def test_files_with_levels_without_and_with_wrong_ones(tmp_path: Path) -> None:
    graph = room_with(tmp_path, FLOOR, ROOF)
    graph.save(tmp_path / "a.json")
    assert SceneGraph.load(tmp_path / "a.json") == graph and len(graph.level_surfaces) == 2
    floor = graph.floors[0].id
    assert graph.on_floor(floor).level_surfaces == graph.level_surfaces and not graph.on_floor("attic").level_surfaces
    value = json.loads((tmp_path / "a.json").read_text())
    older = {name: part for name, part in value.items() if name != "level_surfaces"}
    assert SceneGraph.from_dict(older).level_surfaces == ()
    for change, message in (
        ({"room": "gone"}, "missing room 'gone'"),
        ({"plane": [0.0, 0.8, 0.6, 0.0]}, "steep"),
        ({"plane": [0.0, 0.0, 2.0, 0.0]}, "unit length"),
        ({"polygon": [[0.0, 0.0], [1.0, 0.0]]}, "fewer than three corners"),
        ({"plane": [0.0, 1.0]}, "plane"),
    ):
        wrong = value["level_surfaces"][0] | change
        with pytest.raises(UserError, match=message) as error:
            SceneGraph.from_dict(value | {"level_surfaces": [wrong]})
        assert "\n" not in str(error.value)
