"""The elements of an IFC model that are compared with the building: walls, columns, slabs, ceilings, doors, windows."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from threading import Lock

import ifcopenshell
import numpy as np
from ifcopenshell.util.element import get_container
from numpy.typing import NDArray

from data.ifc.products import IfcProduct, Mesh, open_ifc, products, triangulated
from data.plans.bodies import PANE, Kind, PlannedElement
from data.plans.grid_lines import grid_families, grid_reference

_ONE_AT_A_TIME = Lock()
SOLID = ("IfcWall", "IfcColumn", "IfcSlab", "IfcCovering", "IfcCurtainWall")
FILLINGS = ("IfcDoor", "IfcWindow")


def planned_elements(ifc: Path | str) -> tuple[PlannedElement, ...]:
    """The elements of a model, with what has no geometry left out. Raises UserError as `open_ifc` does.

    Those of the last model are kept; another thread may have asked for them already, which then is waited for.
    """
    path = Path(ifc)
    with _ONE_AT_A_TIME:
        return _planned_elements(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(1)
def _planned_elements(ifc: Path, mtime_ns: int) -> tuple[PlannedElement, ...]:
    model = open_ifc(ifc)
    storeys = {storey.GlobalId: storey.Name or storey.GlobalId for storey in model.by_type("IfcBuildingStorey")}
    found = [_element(product, storeys, "solid") for product in products(model, SOLID)]
    families = grid_families(model)
    return tuple(
        replace(element, grid=grid_reference(families, element.triangles.reshape(-1, 3)[:, :2]))
        for element in (*found, *_openings(model, storeys))
    )


def _element(product: IfcProduct, storeys: dict[str, str], kind: Kind) -> PlannedElement:
    triangles = product.vertices[product.faces]
    storey = storeys.get(product.storey or "", "")
    pane = PANE if product.ifc_class == "IfcCurtainWall" else 0.0
    return PlannedElement(product.global_id, product.ifc_class, product.name, storey, kind, triangles, pane=pane)


def _openings(model: ifcopenshell.file, storeys: dict[str, str]) -> Iterator[PlannedElement]:
    """The openings that doors and windows fill."""
    for filling in dict.fromkeys(entity for kind in FILLINGS for entity in model.by_type(kind)):
        cuts = [fills.RelatingOpeningElement for fills in filling.FillsVoids]
        bodies = [triangulated(cut) for cut in cuts if cut is not None]  # a broken model refers to what it lacks
        body = next((mesh for mesh in bodies if mesh is not None), None)
        if body is None:
            continue
        container = get_container(filling)
        storey = storeys.get(container.GlobalId, "") if container is not None else ""
        yield PlannedElement(
            filling.GlobalId, filling.is_a(), filling.Name or "", storey, "opening", _corners(body),
            wall=_wall_around(filling), filling=_body(filling),
        )  # fmt: skip


def _wall_around(filling: ifcopenshell.entity_instance) -> str:
    """The GlobalId of what a door's or window's opening is cut out of, empty where the model does not say."""
    cuts = [fills.RelatingOpeningElement for fills in filling.FillsVoids]
    walls = [relation.RelatingBuildingElement for cut in cuts if cut is not None for relation in cut.VoidsElements]
    return next((str(wall.GlobalId) for wall in walls if wall is not None), "")


def _body(filling: ifcopenshell.entity_instance) -> NDArray[np.float64] | None:
    mesh = triangulated(filling)
    return None if mesh is None else _corners(mesh)


def _corners(mesh: Mesh) -> NDArray[np.float64]:
    vertices, faces = mesh
    return vertices[faces]


def other_bodies(ifc: Path | str) -> NDArray[np.float64]:
    """(M, 3, 3) the triangles, metres in the BIM frame, of all that the model has besides `planned_elements`: stairs,
    railings, beams, furniture. Raises UserError as `open_ifc` does."""
    model = open_ifc(ifc)
    known = (*SOLID, *FILLINGS, "IfcFeatureElement", "IfcVirtualElement", "IfcGeographicElement")
    others = sorted({e.is_a() for e in model.by_type("IfcElement") if not any(e.is_a(c) for c in known)})
    bodies = [product.vertices[product.faces] for product in products(model, tuple(others))]
    return np.concatenate(bodies or [np.empty((0, 3, 3))])
