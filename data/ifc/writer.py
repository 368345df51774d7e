"""Writes a building as an IFC4 file: storeys, and products whose bodies are vertical prisms."""

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import ifcopenshell
import ifcopenshell.api.aggregate
import ifcopenshell.api.context
import ifcopenshell.api.feature
import ifcopenshell.api.geometry
import ifcopenshell.api.project
import ifcopenshell.api.root
import ifcopenshell.api.spatial
import ifcopenshell.api.unit
import ifcopenshell.guid
import numpy as np
from ifcopenshell.util.representation import get_context
from ifcopenshell.util.shape_builder import ShapeBuilder
from ifcopenshell.util.unit import calculate_unit_scale
from numpy.typing import NDArray

from data.common.files import write_atomically

Entity: TypeAlias = ifcopenshell.entity_instance
Matrix = NDArray[np.float64]  # (4, 4)
STAMP = "2025-01-01T00:00:00"  # in every file's header: the same building gives the same bytes


@dataclass(frozen=True)
class Prism:
    """The volume above `outline` (corners x y, not closed) from z `low` to `high`, in metres, without its `holes`."""

    outline: tuple[tuple[float, float], ...]
    low: float
    high: float
    holes: tuple[tuple[tuple[float, float], ...], ...] = ()


def box(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> Prism:
    """Returns the prism between two corners."""
    return Prism(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), z0, z1)


def placed(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Matrix:
    """Returns T (4, 4): rotation about z by `yaw` (radians), then translation by x y z (metres)."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = x, y, z
    return T


class IfcWriter:
    """Adds to a model that `begun` began, of one site and one building; `T_bim_building` is where both stand.

    A storey is named in all calls; a body is given in its product's frame, which `T_storey_product` places in
    the storey's: the building's, raised by the storey's elevation.
    """

    def __init__(self, model: ifcopenshell.file, T_bim_building: Matrix | None = None) -> None:
        self.model = model
        self._T_bim_building = np.eye(4) if T_bim_building is None else T_bim_building
        self._builder = ShapeBuilder(model)

    @classmethod
    def begun(
        cls,
        project: str,
        elevations: Mapping[str, float],
        T_bim_building: Matrix | None = None,
        millimetres: bool = False,
    ) -> "IfcWriter":
        """A new model, of storeys without products."""
        writer = cls(ifcopenshell.api.project.create_file(version="IFC4"), T_bim_building)
        root = writer._entity("IfcProject", project)
        raw = "MILLIMETERS" if millimetres else "METERS"
        ifcopenshell.api.unit.assign_unit(writer.model, length={"is_metric": True, "raw": raw})
        context = ifcopenshell.api.context.add_context(writer.model, context_type="Model")
        ifcopenshell.api.context.add_context(
            writer.model, "Model", context_identifier="Body", target_view="MODEL_VIEW", parent=context
        )
        site, building = writer._entity("IfcSite", f"{project} site"), writer._entity("IfcBuilding", project)
        writer._aggregate(site, root)
        writer._aggregate(building, site)
        writer._place(site, writer._T_bim_building)
        writer._place(building, writer._T_bim_building)
        for name, elevation in elevations.items():
            storey = writer._entity("IfcBuildingStorey", name)
            storey.Elevation = elevation * writer._metre
            writer._aggregate(storey, building)
            writer._place(storey, writer._T_bim_building @ placed(0.0, 0.0, elevation))
        return writer

    @cached_property
    def _metre(self) -> float:
        """In the model's unit."""
        return 1.0 / float(calculate_unit_scale(self.model))

    @cached_property
    def _body(self) -> Entity:
        """The context of the products' bodies."""
        return get_context(self.model, "Model", "Body", "MODEL_VIEW")

    @cached_property
    def _storeys(self) -> dict[str, Entity]:
        return {storey.Name: storey for storey in self.model.by_type("IfcBuildingStorey")}

    def element(
        self,
        ifc_class: str,
        name: str,
        storey: str,
        body: Sequence[Prism],
        T_storey_product: Matrix | None = None,
        kind: str | None = None,
    ) -> Entity:
        """Adds a product that a storey contains; `kind` is its PredefinedType."""
        product = self._entity(ifc_class, name, kind)
        container = self._storeys[storey]
        ifcopenshell.api.spatial.assign_container(self.model, [product], relating_structure=container)
        self._shape(product, storey, body, T_storey_product)
        return product

    def cut(
        self,
        host: Entity,
        storey: str,
        hole: Prism,
        T_storey_hole: Matrix | None = None,
        filling: Entity | None = None,
    ) -> None:
        """Cuts an opening into a wall or slab; `filling` is the door or window in it."""
        opening = self._entity("IfcOpeningElement", f"{host.Name} opening", "OPENING")
        self._shape(opening, storey, [hole], T_storey_hole)
        ifcopenshell.api.feature.add_feature(self.model, feature=opening, element=host)
        if filling is not None:
            ifcopenshell.api.feature.add_filling(self.model, opening=opening, element=filling)

    def space(self, name: str, storey: str, body: Prism) -> Entity:
        """Adds a room."""
        product = self._entity("IfcSpace", name)
        self._aggregate(product, self._storeys[storey])
        self._shape(product, storey, [body])
        return product

    def save(self, path: Path | str) -> None:
        """Creates all GlobalIds from the project's name and the order of creation, and writes the file."""
        project = self.model.by_type("IfcProject")[0].Name
        for number, root in enumerate(self.model.by_type("IfcRoot")):
            own = uuid.uuid5(uuid.NAMESPACE_OID, f"{project}/{number}")
            root.GlobalId = ifcopenshell.guid.compress(own.hex)
        # ifcopenshell keeps these in sets, whose order changes from call to call
        for ifc_class, name in (
            ("IfcUnitAssignment", "Units"),
            ("IfcRelContainedInSpatialStructure", "RelatedElements"),
            ("IfcRelAggregates", "RelatedObjects"),
        ):
            for entity in self.model.by_type(ifc_class):
                setattr(entity, name, sorted(getattr(entity, name), key=lambda member: member.id()))
        self.model.header.file_name.name = f"{project}.ifc"  # not the path: it shall not change the bytes
        self.model.header.file_name.time_stamp = STAMP
        write_atomically(path, self.model.to_string())

    def _entity(self, ifc_class: str, name: str, kind: str | None = None) -> Entity:
        return ifcopenshell.api.root.create_entity(self.model, ifc_class=ifc_class, name=name, predefined_type=kind)

    def _aggregate(self, part: Entity, whole: Entity) -> None:
        ifcopenshell.api.aggregate.assign_object(self.model, products=[part], relating_object=whole)

    def _place(self, product: Entity, T_bim_product: Matrix) -> None:
        ifcopenshell.api.geometry.edit_object_placement(self.model, product=product, matrix=T_bim_product)

    def _profile(self, prism: Prism) -> Entity:
        """Its curve, or with holes its area."""
        outer, *inner = (
            self._builder.polyline([tuple(self._metre * v for v in xy) for xy in ring], closed=True)
            for ring in (prism.outline, *prism.holes)
        )
        return self._builder.profile(outer, inner_curves=inner) if inner else outer

    def _shape(
        self, product: Entity, storey: str, body: Sequence[Prism], T_storey_product: Matrix | None = None
    ) -> None:
        solids = [
            self._builder.extrude(
                self._profile(p),
                magnitude=self._metre * (p.high - p.low),
                position=(0.0, 0.0, self._metre * p.low),
            )
            for p in body
        ]
        shape = self._builder.get_representation(self._body, solids)
        ifcopenshell.api.geometry.assign_representation(self.model, product=product, representation=shape)
        T_bim_storey = self._T_bim_building @ placed(0.0, 0.0, self._storeys[storey].Elevation / self._metre)
        self._place(product, T_bim_storey if T_storey_product is None else T_bim_storey @ T_storey_product)
