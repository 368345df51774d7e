"""The grid lines of a model, and how an element is found by them."""

from pathlib import Path

import ifcopenshell
import ifcopenshell.guid
import numpy as np
import pytest
from small_ifc import write_small_ifc

from data.plans.elements import planned_elements
from data.plans.grid_lines import GridLine, grid_families, grid_reference

YAW = 0.4


def with_grid(path: Path, millimetres: bool) -> Path:
    """The small building with lines A, B, C at x = 0, 5, 10 and 1, 2, 3 at y = 0, 3.1, 7; one of them is drawn the
    other way round, and an arc is among them."""
    building = write_small_ifc(path, site=(3000.0, -2000.0, 40.0), yaw=YAW, millimetres=millimetres)
    model = ifcopenshell.open(str(building.path))
    unit = 1000.0 if millimetres else 1.0

    def axis(tag: str, *ends: tuple[float, float]) -> ifcopenshell.entity_instance:
        points = [model.create_entity("IfcCartesianPoint", [unit * x, unit * y]) for x, y in ends]
        return model.create_entity("IfcGridAxis", tag, model.create_entity("IfcPolyline", points), True)

    letters = [axis("A", (0, -1), (0, 8)), axis("B", (5, 8), (5, -1)), axis("C", (10, -1), (10, 8))]
    numbers = [axis("1", (-1, 0), (11, 0)), axis("2", (-1, 3.1), (11, 3.1)), axis("3", (-1, 7), (11, 7))]
    bent = axis("X", (0, 0), (1, 1), (2, 0))
    storey = model.by_type("IfcBuildingStorey")[0]
    model.create_entity(
        "IfcGrid", ifcopenshell.guid.new(), None, "grid", ObjectPlacement=storey.ObjectPlacement,
        UAxes=[*letters, bent], VAxes=numbers,
    )  # fmt: skip
    model.write(str(path))
    return path


@pytest.mark.parametrize("millimetres", [False, True])
def test_elements_are_found_by_the_grid(tmp_path: Path, millimetres: bool) -> None:
    found = {element.name: element for element in planned_elements(with_grid(tmp_path / "a.ifc", millimetres))}
    told = {name: element.grid for name, element in found.items()}
    assert told["south"] == "A-C/1" and told["west"] == "A/1-3" and told["between"] == "B/2-3"
    assert told["window"] == "A-B/3"


def test_a_model_without_a_grid_tells_none(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "a.ifc")
    assert {element.grid for element in planned_elements(building.path)} == {""}
    assert grid_families(ifcopenshell.open(str(building.path))) == []


def test_beside_on_and_between_lines() -> None:
    family = [GridLine(tag, np.array([[x, 0.0], [x, 9.0]])) for tag, x in (("A", 0.0), ("B", 6.0), ("C", 12.0))]

    def at(low: float, high: float) -> str:
        return grid_reference([family], np.array([[low, 1.0], [high, 2.0]]))

    assert [at(-3.0, -2.0), at(-0.4, 0.1), at(0.6, 1.0), at(5.0, 5.6), at(7.0, 14.0), at(13.0, 14.0)] == [
        "A", "A", "A-B", "B", "C", "C",
    ]  # fmt: skip
