"""Triangulated products of an IFC model, in the BIM frame: world coordinates in metres, site placement included."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.element
import numpy as np
from numpy.typing import NDArray

from data.errors import UserError


@dataclass(frozen=True)
class IfcProduct:
    """One product: `vertices` (N, 3) metres in the BIM frame, `faces` (M, 3) indices into them."""

    global_id: str
    ifc_class: str
    name: str
    storey: str | None  # GlobalId of the IfcBuildingStorey that contains it
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]


def open_ifc(path: Path | str) -> ifcopenshell.file:
    """Opens an IFC file; raises UserError where it is missing or not IFC."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such file; give an IFC file")
    try:
        return ifcopenshell.open(str(path))
    except Exception as error:  # ifcopenshell raises its own kinds, OSError and RuntimeError
        raise UserError(f"{path}: cannot be read as IFC ({type(error).__name__}); give an IFC file") from None


def products(model: ifcopenshell.file, classes: tuple[str, ...]) -> Iterator[IfcProduct]:
    """Yields the products of these classes (subclasses too) that have a geometry.

    Products whose geometry cannot be made are left out. Openings are subtracted.
    """
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    wanted = [p for c in classes for p in model.by_type(c) if p.Representation is not None]
    for product in dict.fromkeys(wanted):
        try:
            shape = ifcopenshell.geom.create_shape(settings, product)
        except RuntimeError:
            continue
        vertices = np.asarray(shape.geometry.verts, dtype=float).reshape(-1, 3)
        faces = np.asarray(shape.geometry.faces, dtype=np.int32).reshape(-1, 3)
        if len(faces):
            yield IfcProduct(product.GlobalId, product.is_a(), product.Name or "", _storey(product), vertices, faces)


def _storey(product: ifcopenshell.entity_instance) -> str | None:
    container = ifcopenshell.util.element.get_container(product) or ifcopenshell.util.element.get_aggregate(product)
    while container is not None and not container.is_a("IfcBuildingStorey"):
        container = ifcopenshell.util.element.get_aggregate(container) or ifcopenshell.util.element.get_container(
            container
        )
    return container.GlobalId if container is not None else None
