"""ifcopenshell at its smallest: whether it works here."""

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid


def work() -> None:
    """Fails where ifcopenshell does not work here."""
    model = ifcopenshell.file(schema="IFC4")
    model.create_entity("IfcProject", ifcopenshell.guid.new())
    assert len(model.by_type("IfcProject")) == 1
