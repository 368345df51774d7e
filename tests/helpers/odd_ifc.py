"""Odd IFC models, as programs export them: one house of two rooms, A and B, each time written another way."""

from collections.abc import Callable
from typing import Any

import ifcopenshell
import ifcopenshell.api.aggregate
import ifcopenshell.api.georeference
import ifcopenshell.api.spatial
import numpy as np
from ifc_models import Entity, IfcModel, Polygon, Xyz, box

from data.ifc.writer import placed

HIGH = (0.0, 2.7)
SPACES: dict[str, Polygon] = {"A": box(0, 0, 4, 5), "B": box(4.2, 0, 8.2, 5)}
SWISS: Xyz = (2_600_000.123, 1_200_000.456, 408.7)


def house(
    unit: str = "metres",
    version: str = "IFC4",
    drawn_at: Xyz = (0.0, 0.0, 0.0),
    yaw: float = 0.0,
    spaces: int = 1,
    west: bool = True,
    body: str = "IfcWall",
) -> IfcModel:
    """A and B, 4 m x 5 m each, 0.2 m between them with a door, and a door out of B."""
    model = IfcModel(unit, placed(0.0, 0.0, 0.0, yaw), version, drawn_at)
    storey = model.storey("ground", 0.0)
    south = model.prism(body, box(-0.3, -0.3, 8.5, 0), HIGH, storey)
    model.prism(body, box(-0.3, 5, 8.5, 5.3), HIGH, storey)
    model.prism(body, box(8.2, 0, 8.5, 5), HIGH, storey)
    if west:
        model.prism(body, box(-0.3, 0, 0, 5), HIGH, storey)
    between = model.prism(body, box(4, 0, 4.2, 5), HIGH, storey)
    model.opening(between, box(3.9, 2, 4.3, 2.9), (0.0, 2.1), "IfcDoor")
    model.opening(south, box(6, -0.4, 7, 0.1), (0.0, 2.1), "IfcDoor")
    for _ in range(spaces):
        for name, area in SPACES.items():
            model.prism("IfcSpace", area, (0.0, 2.5), storey, name)
    return model


def _storey(model: IfcModel) -> Entity:
    return model.file.by_type("IfcBuildingStorey")[0]


def _contained(model: IfcModel, storey: Entity, whole: Entity) -> IfcModel:
    """All elements of the storey in another spatial element."""
    elements = [e for r in storey.ContainsElements for e in r.RelatedElements]
    ifcopenshell.api.spatial.assign_container(model.file, products=elements, relating_structure=whole)
    return model


def _part(model: IfcModel, ifc_class: str, whole: Entity, **values: Any) -> Entity:
    part = model.entity(ifc_class, ifc_class)
    for name, value in values.items():
        setattr(part, name, value)
    ifcopenshell.api.aggregate.assign_object(model.file, products=[part], relating_object=whole)
    return part


def georeferenced() -> IfcModel:
    """A map conversion, which says where the local origin lies, on top of local coordinates."""
    model = house(version="IFC4")
    ifcopenshell.api.georeference.add_georeferencing(model.file)
    operation = {"Eastings": SWISS[0], "Northings": SWISS[1], "OrthogonalHeight": SWISS[2]}
    ifcopenshell.api.georeference.edit_georeferencing(model.file, coordinate_operation=operation)
    return model


def true_north() -> IfcModel:
    """True north is 30 degrees off the plan's y axis."""
    model = house(yaw=0.4)
    for context in model.file.by_type("IfcGeometricRepresentationContext", include_subtypes=False):
        context.TrueNorth = model.file.createIfcDirection((0.5, float(np.sqrt(0.75))))
    return model


def world_offset() -> IfcModel:
    """A context whose own axes are moved."""
    model = house()
    point = model.file.createIfcCartesianPoint((100.0, 50.0, 10.0))
    for context in model.file.by_type("IfcGeometricRepresentationContext", include_subtypes=False):
        context.WorldCoordinateSystem = model.file.createIfcAxis2Placement3D(point)
    return model


def _second(model: IfcModel, storey: Entity, x: float, z: float, space: bool = True) -> IfcModel:
    """Four more walls around one room, in a storey."""
    high = (z, z + 2.7)
    for x0, y0, x1, y1 in ((-0.3, -0.3, 8.5, 0), (-0.3, 5, 8.5, 5.3), (8.2, 0, 8.5, 5), (-0.3, 0, 0, 5)):
        model.prism("IfcWall", box(x + x0, y0, x + x1, y1), high, storey)
    if space:
        model.prism("IfcSpace", box(x, 0, x + 8.2, 5), (z, z + 2.5), storey, "C")
    return model


def storeys_without_rooms() -> IfcModel:
    """A second storey has walls, but its space was not exported."""
    model = house()
    return _second(model, model.storey("first", 3.0), 0.0, 3.0, space=False)


def two_buildings() -> IfcModel:
    """A second building beside the first, with a storey of its own at the same height."""
    model = house()
    model.building = _part(model, "IfcBuilding", model.site)
    return _second(model, model.storey("next door", 0.0), 30.0, 0.0)


def two_levels() -> IfcModel:
    """The walls are in the storey of the structure, the spaces in that of the finished floor."""
    model = house()
    finished, spaces = model.storey("finished", 0.1), model.file.by_type("IfcSpace")
    ifcopenshell.api.aggregate.assign_object(model.file, products=spaces, relating_object=finished)
    return model


def spaces_without_bodies() -> IfcModel:
    """Spaces as names only."""
    model = house()
    for space in model.file.by_type("IfcSpace"):
        space.Representation = None
    return model


def flat_spaces() -> IfcModel:
    """Spaces with their outline on the floor alone, as a curve."""
    model = house()
    for space in model.file.by_type("IfcSpace"):
        for shape in space.Representation.Representations:
            shape.Items = [item.SweptArea.OuterCurve for item in shape.Items]
            shape.RepresentationIdentifier, shape.RepresentationType = "FootPrint", "Curve2D"
    return model


def curved() -> IfcModel:
    """The west wall is half a circle, of sixty facets, and its room too."""
    model = house(west=False, spaces=0)
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 61)
    arc = np.column_stack([2.5 * np.cos(turn), 2.5 + 2.5 * np.sin(turn)])
    outer = np.column_stack([2.8 * np.cos(turn), 2.5 + 2.8 * np.sin(turn)])
    storey = _storey(model)
    model.prism("IfcWall", [tuple(p) for p in (*outer.tolist(), *arc[::-1].tolist())], HIGH, storey)
    model.prism("IfcSpace", [(4, 0), (4, 5), *map(tuple, arc.tolist())], (0.0, 2.5), storey, "A")
    model.prism("IfcSpace", SPACES["B"], (0.0, 2.5), storey, "B")
    return model


def curtain() -> IfcModel:
    """The west wall is a curtain wall: an assembly of panes and posts without a body."""
    model = house(west=False)
    storey = _storey(model)
    wall = model.entity("IfcCurtainWall", "curtain")
    ifcopenshell.api.spatial.assign_container(model.file, products=[wall], relating_structure=storey)
    parts = [model.prism("IfcPlate", box(-0.12, k, -0.1, k + 1), HIGH, storey) for k in range(5)]
    parts += [model.prism("IfcMember", box(-0.15, k, -0.05, k + 0.05), HIGH, storey) for k in range(5)]
    ifcopenshell.api.aggregate.assign_object(model.file, products=parts, relating_object=wall)
    return model


def no_storeys(spaces: int) -> IfcModel:
    """Two storeys, all in the building itself."""
    model = house(spaces=spaces)
    _second(model, model.storey("first", 3.0), 0.0, 3.0, bool(spaces))
    rooms = model.file.by_type("IfcSpace")
    if rooms:
        ifcopenshell.api.aggregate.assign_object(model.file, products=rooms, relating_object=model.building)
    for storey in model.file.by_type("IfcBuildingStorey"):
        _contained(model, storey, model.building)
        ifcopenshell.api.aggregate.unassign_object(model.file, products=[storey])
        model.file.remove(storey)
    return model


def in_a_spatial_zone() -> IfcModel:
    """The elements are in a spatial zone, which is in no storey."""
    model = house()
    return _contained(model, _storey(model), _part(model, "IfcSpatialZone", model.building))


def in_parts_of_buildings() -> IfcModel:
    """The storey is in a part of the building, and in a part of itself."""
    model = house()
    wing = _part(model, "IfcBuilding", model.building, CompositionType="PARTIAL")
    storey = _storey(model)
    ifcopenshell.api.aggregate.assign_object(model.file, products=[storey], relating_object=wing)
    half = _part(model, "IfcBuildingStorey", storey, CompositionType="PARTIAL")
    half.ObjectPlacement = storey.ObjectPlacement
    return _contained(model, _storey(model), half)


def in_their_rooms() -> IfcModel:
    """The walls are in a space."""
    model = house()
    return _contained(model, _storey(model), model.file.by_type("IfcSpace")[0])


def layers() -> IfcModel:
    """Each wall is an assembly of two layers, which are walls' parts."""
    model = house(west=False)
    wall = model.entity("IfcWall", "west")
    ifcopenshell.api.spatial.assign_container(model.file, products=[wall], relating_structure=_storey(model))
    parts = [
        model.prism("IfcBuildingElementPart", box(low, 0, high, 5), HIGH, _storey(model))
        for low, high in ((-0.3, -0.1), (-0.1, 0))
    ]
    ifcopenshell.api.aggregate.assign_object(model.file, products=parts, relating_object=wall)
    return model


def panels() -> IfcModel:
    """A wall that is an assembly of walls, as precast ones are."""
    model = house(west=False)
    wall = model.entity("IfcWall", "west")
    ifcopenshell.api.spatial.assign_container(model.file, products=[wall], relating_structure=_storey(model))
    parts = [model.prism("IfcWall", box(-0.3, low, 0, low + 2.5), HIGH, _storey(model)) for low in (0, 2.5)]
    ifcopenshell.api.aggregate.assign_object(model.file, products=parts, relating_object=wall)
    return model


def wrong_unit() -> IfcModel:
    """Millimetres that the file calls metres."""
    model = house("millimetres")
    (unit,) = (u for u in model.file.by_type("IfcSIUnit") if u.UnitType == "LENGTHUNIT")
    unit.Prefix = None
    return model


def axes_alone() -> IfcModel:
    """Walls with their axis as a line and no body."""
    model = house()
    for wall in model.file.by_type("IfcWall"):
        for shape in wall.Representation.Representations:
            shape.Items = [item.SweptArea.OuterCurve for item in shape.Items]
            shape.RepresentationIdentifier, shape.RepresentationType = "Axis", "Curve2D"
    return model


def ids_twice() -> IfcModel:
    """A copied storey whose products kept their ids."""
    model = house()
    for ifc_class in ("IfcWall", "IfcSpace", "IfcDoor"):
        entities = model.file.by_type(ifc_class)
        entities[-1].GlobalId = entities[0].GlobalId
    return model


ODD: dict[str, Callable[[], IfcModel]] = {
    "georeferenced": georeferenced,
    "drawn in the country's grid": lambda: house(drawn_at=SWISS),
    "feet": lambda: house("feet"),
    "millimetres": lambda: house("millimetres"),
    "true north": true_north,
    "moved world axes": world_offset,
    "storeys without rooms": storeys_without_rooms,
    "two buildings": two_buildings,
    "structural and finished storeys": two_levels,
    "spaces thrice": lambda: house(spaces=3),
    "spaces without bodies": spaces_without_bodies,
    "flat spaces": flat_spaces,
    "no spaces": lambda: house(spaces=0),
    "curved": curved,
    "curtain": curtain,
    "IFC4X3": lambda: house(version="IFC4X3_ADD2"),
    "no storeys": lambda: no_storeys(1),
    "no storeys, no spaces": lambda: no_storeys(0),
    "in a spatial zone": in_a_spatial_zone,
    "in parts of buildings": in_parts_of_buildings,
    "in their rooms": in_their_rooms,
    "layers": layers,
    "panels": panels,
    "wrong unit": wrong_unit,
    "proxies": lambda: house(body="IfcBuildingElementProxy"),
    "axes alone": axes_alone,
    "ids twice": ids_twice,
}
