"""Checks that ifcopenshell works on this machine."""

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid


def work() -> None:
    """Raises if ifcopenshell does not work on this machine."""
    model = ifcopenshell.file(schema="IFC4")
    model.create_entity("IfcProject", ifcopenshell.guid.new())
    assert len(model.by_type("IfcProject")) == 1
