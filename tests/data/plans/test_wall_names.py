"""How walls are told apart and found: which surfaces are faces of one wall, which wall is where, and by the grid."""

from pathlib import Path

import ifcopenshell
import ifcopenshell.guid
import pytest
from small_ifc import write_small_ifc

from data.ifc.writer import IfcWriter, box
from data.plans import load_bim
from data.plans.elements import planned_elements
from data.scene_graph import WallSurface
from data.scene_graph.segments import wall_names

Xy = tuple[float, float]


def face(id: str, centroid: Xy, normal: Xy, source: str = "") -> WallSurface:
    return WallSurface(id, None, centroid, normal, 4.0, source=source)


def walls(*surfaces: WallSurface) -> set[str]:
    """The ids of the faces of each wall, as a word."""
    names = wall_names(surfaces)
    return {"".join(sorted(s for s, own in names.items() if own == name)) for name in names.values()}


@pytest.mark.parametrize(
    ("centroid", "normal", "together"),
    [
        ((-0.2, 1.0), (-1, 0), True),  # the other side
        ((-0.8, 1.0), (-1, 0), False),  # thicker than a wall
        ((0.3, 1.0), (-1, 0), False),  # they face each other
        ((-0.2, 4.5), (-1, 0), False),  # beyond its end
        ((0.01, 30.0), (1, 0), True),  # in line
        ((0.05, 30.0), (1, 0), False),  # not in line
        ((0.0, 1.0), (0, 1), False),  # across
    ],
)
def test_without_sources_the_place_tells_which_faces_are_one_wall(centroid: Xy, normal: Xy, together: bool) -> None:
    for reverse in (False, True):
        pair = [face("a", (0, 0), (1, 0)), face("b", centroid, normal)][:: -1 if reverse else 1]
        assert walls(*pair) == ({"ab"} if together else {"a", "b"})


def test_a_source_is_a_wall_and_faces_that_share_a_third_are_one() -> None:
    sourced = face("a", (0, 0), (1, 0), "w1"), face("b", (9, 9), (0, 1), "w1"), face("c", (0, 0), (1, 0), "w2")
    assert walls(*sourced) == {"ab", "c"}
    chain = [face("a", (0, 0), (1, 0)), face("b", (-0.2, 0), (-1, 0)), face("c", (-0.2, 9), (-1, 0))]
    assert walls(*chain, face("d", (0, 0), (1, 0), "w")) == {"abc", "d"}
    assert wall_names([]) == {}


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_elements_are_found_by_the_grid(tmp_path: Path, unit: float) -> None:
    """Lines A, B, C at x = 0, 5, 10 and 1, 2, 3 at y = 0, 3.1, 7; one is drawn the other way round, one is an arc."""
    building = write_small_ifc(tmp_path / "a.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.4, millimetres=unit > 1)
    assert {element.grid for element in planned_elements(building.path)} == {""}
    model = ifcopenshell.open(str(building.path))

    def axis(tag: str, *ends: Xy) -> ifcopenshell.entity_instance:
        points = [model.create_entity("IfcCartesianPoint", [unit * x, unit * y]) for x, y in ends]
        return model.create_entity("IfcGridAxis", tag, model.create_entity("IfcPolyline", points), True)

    letters = [axis("A", (0, -1), (0, 8)), axis("B", (5, 8), (5, -1)), axis("C", (10, -1), (10, 8))]
    numbers = [axis("1", (-1, 0), (11, 0)), axis("2", (-1, 3.1), (11, 3.1)), axis("3", (-1, 7), (11, 7))]
    place = model.by_type("IfcBuildingStorey")[0].ObjectPlacement
    axes = {"UAxes": [*letters, axis("X", (0, 0), (1, 1), (2, 0))], "VAxes": numbers}
    model.create_entity("IfcGrid", ifcopenshell.guid.new(), None, "grid", ObjectPlacement=place, **axes)
    model.write(str(tmp_path / "b.ifc"))
    grid = {element.name: element.grid for element in planned_elements(tmp_path / "b.ifc")}
    assert grid["south"] == "A-C/1" and grid["west"] == "A/1-3" and grid["between"] == "B/2-3"
    assert grid["window"] == "A-B/3"


def test_a_plan_tells_which_wall_stands_where_in_a_plane(tmp_path: Path) -> None:
    """A room of 8 m by 4 m, whose northern side two walls of the model make, the second with a door."""
    writer = IfcWriter.begun("Two in a row", {"Ground": 0.0})
    for name, first, last in (("first", 0.0, 3.0), ("second", 3.0, 8.0)):
        host = writer.element("IfcWall", name, "Ground", [box(first, 4.0, 0.0, last, 4.2, 2.6)])
    writer.cut(host, "Ground", box(5.0, 4.0, 0.0, 6.0, 4.2, 2.1))
    writer.space("Room", "Ground", box(0.0, 0.0, 0.0, 8.0, 4.0, 2.6))
    writer.save(tmp_path / "row.ifc")
    names = {w.GlobalId: w.Name for w in writer.model.by_type("IfcWall")}
    surfaces = load_bim(tmp_path / "row.ifc", tmp_path).graph.wall_surfaces
    (north,) = (w for w in surfaces if w.room and w.normal[1] < -0.9)
    # leftward as one looks along the normal, which points south: eastward
    x = north.centroid[0]
    parts = {(names[s], round(x + low, 2), round(x + high, 2)) for s, low, high, whole in north.parts if whole}
    assert parts == {("first", 0.0, 3.0), ("second", 3.0, 5.0), ("second", 6.0, 8.0)}
