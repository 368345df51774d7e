"""Small IFC models whose truth is known, made of upright prisms."""

from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.api.aggregate
import ifcopenshell.api.feature
import ifcopenshell.api.owner
import ifcopenshell.api.owner.settings
import ifcopenshell.api.project
import ifcopenshell.api.root
import ifcopenshell.api.spatial
import ifcopenshell.api.unit
import numpy as np
from ifcopenshell.api.context import add_context
from ifcopenshell.api.geometry import assign_representation, edit_object_placement
from numpy.typing import NDArray

Polygon = list[tuple[float, float]]
Entity = Any  # ifcopenshell.entity_instance
Xyz = tuple[float, float, float]
UNITS = {"metres": (1.0, "METERS"), "millimetres": (0.001, "MILLIMETERS"), "feet": (0.3048, "FEET")}


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """A rectangle's corners."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


class IfcModel:
    """An IFC file under construction; all lengths in metres in the building's own axes.

    `T_world_building` (4, 4) is the site's placement; `unit` is the file's unit of length; `drawn_at` is added to all
    coordinates, as some programs export every point in the country's own grid.
    """

    def __init__(
        self, unit: str = "metres", T_world_building: Any = None, version: str = "IFC4", drawn_at: Xyz = (0.0, 0.0, 0.0)
    ) -> None:
        self.drawn_at = np.array(drawn_at)
        self.file = ifcopenshell.api.project.create_file(version=version)
        if version == "IFC2X3":
            self._sign()
        self.scale, length = UNITS[unit]
        self.T_world_building = np.eye(4) if T_world_building is None else T_world_building
        project = self.entity("IfcProject", "project")
        ifcopenshell.api.unit.assign_unit(self.file, length={"is_metric": unit != "feet", "raw": length})
        self.body = add_context(self.file, "Model", "Body", "MODEL_VIEW", parent=add_context(self.file, "Model"))
        self.site, self.building = self.entity("IfcSite", "site"), self.entity("IfcBuilding", "building")
        for child, parent in ((self.site, project), (self.building, self.site)):
            ifcopenshell.api.aggregate.assign_object(self.file, products=[child], relating_object=parent)
        self._place(self.site, 0.0)
        self._place(self.building, 0.0)

    def storey(self, name: str, z: float) -> Entity:
        """An empty storey."""
        storey = self.entity("IfcBuildingStorey", name)
        ifcopenshell.api.aggregate.assign_object(self.file, products=[storey], relating_object=self.building)
        self._place(storey, z + self.drawn_at[2])
        return storey

    def prism(self, ifc_class: str, polygon: Polygon, z: tuple[float, float], storey: Entity, name: str = "") -> Entity:
        """A product with an upright prism for a body, in a storey."""
        product = self.entity(ifc_class, name)
        if product.is_a("IfcSpatialStructureElement"):
            ifcopenshell.api.aggregate.assign_object(self.file, products=[product], relating_object=storey)
        else:
            ifcopenshell.api.spatial.assign_container(self.file, products=[product], relating_structure=storey)
        self._shape(product, polygon, z)
        return product

    def opening(self, wall: Entity, polygon: Polygon, z: tuple[float, float], filling: str | None = None) -> None:
        """Cuts a prism out of a wall, and puts a door or window with the same body into it."""
        opening = self.entity("IfcOpeningElement", "")
        ifcopenshell.api.feature.add_feature(self.file, feature=opening, element=wall)
        self._shape(opening, polygon, z)
        if filling:
            filled = self.entity(filling, filling)
            ifcopenshell.api.feature.add_filling(self.file, opening=opening, element=filled)
            self._shape(filled, polygon, z)

    def save(self, path: Path) -> Path:
        """Writes the file."""
        self.file.write(str(path))
        return path

    def _sign(self) -> None:
        """IFC2X3 wants to know whose everything is."""
        person = ifcopenshell.api.owner.add_person(self.file)
        organisation = ifcopenshell.api.owner.add_organisation(self.file)
        user = ifcopenshell.api.owner.add_person_and_organisation(self.file, person, organisation)
        application = ifcopenshell.api.owner.add_application(self.file, organisation)
        settings = ifcopenshell.api.owner.settings
        settings.get_user = lambda file: user if file is self.file else None
        settings.get_application = lambda file: application if file is self.file else None

    def entity(self, ifc_class: str, name: str) -> Entity:
        return ifcopenshell.api.root.create_entity(self.file, ifc_class=ifc_class, name=name)

    def _place(self, product: Entity, z: float, axis: NDArray[np.float64] | None = None) -> None:
        T = np.eye(4)
        T[2, 3] = z
        if axis is not None:
            T[:2, :2] = np.array([axis, [-axis[1], axis[0]]]).T
        matrix = self.T_world_building @ T
        edit_object_placement(self.file, product=product, matrix=matrix, should_transform_children=True)

    def _shape(self, product: Entity, polygon: Polygon, z: tuple[float, float]) -> None:
        """The local x axis lies along the polygon's longest side, as that of walls and doors does."""
        points = np.array(polygon) + self.drawn_at[:2]
        sides = np.roll(points, -1, axis=0) - points
        axis = sides[np.argmax(np.linalg.norm(sides, axis=1))]
        axis = axis / np.linalg.norm(axis)
        self._place(product, z[0] + self.drawn_at[2], axis)
        local = points @ np.array([axis, [-axis[1], axis[0]]]).T / self.scale
        corners = [self.file.createIfcCartesianPoint(p) for p in [*local.tolist(), local[0].tolist()]]
        profile = self.file.createIfcArbitraryClosedProfileDef("AREA", None, self.file.createIfcPolyline(corners))
        up = self.file.createIfcDirection((0.0, 0.0, 1.0))
        here = self.file.createIfcAxis2Placement3D(self.file.createIfcCartesianPoint((0.0, 0.0, 0.0)))
        solid = self.file.createIfcExtrudedAreaSolid(profile, here, up, (z[1] - z[0]) / self.scale)
        shape = self.file.createIfcShapeRepresentation(self.body, "Body", "SweptSolid", [solid])
        assign_representation(self.file, product=product, representation=shape)
