"""Triangulated products of an IFC model, in the BIM frame: world coordinates in metres, site included."""

import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid
import numpy as np
from ifcopenshell.util.element import get_aggregate, get_container, get_parts
from numpy.typing import NDArray

from data.common.errors import UserError, refusing
from data.walls.solids import Solid, solid_of

MAX_RATIO = 200  # IFC text packs to a tenth, rarely to a fortieth
Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]  # vertices (N, 3), faces (M, 3)


@dataclass(frozen=True)
class IfcProduct:
    """One product: `vertices` (N, 3) metres in the BIM frame, `faces` (M, 3) indices into them."""

    global_id: str
    ifc_class: str
    name: str
    storey: str | None  # GlobalId of the IfcBuildingStorey that contains it
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]

    @property
    def triangles(self) -> NDArray[np.float64]:
        """(M, 3, 3) the corners of its faces."""
        return self.vertices[self.faces]


def open_ifc(path: Path | str) -> ifcopenshell.file:
    """Opens an IFC file. Raises UserError if it is missing, not IFC, or truncated."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such file; give an IFC file")
    if path.suffix.lower() == ".ifczip":
        return _open_zip(path)
    if path.suffix.lower() == ".ifc" and not _is_whole(path):
        raise UserError(f"{path}: not IFC, or cut off (it does not end in END-ISO-10303-21); give a complete IFC file")
    with refusing(f"{path}: cannot be read as IFC", "give an IFC file"):
        return ifcopenshell.open(str(path))


def self_test() -> None:
    """Raises if ifcopenshell does not work on this machine."""
    model = ifcopenshell.file(schema="IFC4")
    model.create_entity("IfcProject", ifcopenshell.guid.new())
    assert len(model.by_type("IfcProject")) == 1


def _open_zip(path: Path) -> ifcopenshell.file:
    """Opens the only .ifc file of an archive."""
    folder = tempfile.TemporaryDirectory(prefix="sgslam-")
    with refusing(f"{path}: cannot be unpacked", "give a complete .ifczip"), zipfile.ZipFile(path) as archive, folder:
        inside = [m for m in archive.infolist() if m.filename.lower().endswith(".ifc") and not m.is_dir()]
        if len(inside) != 1:
            raise UserError(f"{path}: contains {len(inside)} .ifc files; give an archive with one")
        if inside[0].file_size > MAX_RATIO * path.stat().st_size + (1 << 20):
            raise UserError(f"{path}: its .ifc claims {inside[0].file_size:,} bytes; give a complete archive")
        unpacked = Path(archive.extract(inside[0], folder.name))
        if not _is_whole(unpacked):
            raise UserError(f"{path}: the .ifc in it is cut off; give a complete one")
        return ifcopenshell.open(str(unpacked))


def _is_whole(path: Path) -> bool:
    """Whether a STEP file has its end mark; ifcopenshell reads a truncated file without a warning."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 1000))
        return b"END-ISO-10303-21" in file.read()


def products(model: ifcopenshell.file, classes: tuple[str, ...]) -> Iterator[IfcProduct]:
    """Yields the products of these classes (subclasses too) that have a geometry.

    Products whose geometry cannot be made are left out. Openings are subtracted. An assembly without a
    geometry of its own (a curtain wall) has that of its parts, unless these are among the classes themselves.
    """
    wanted = dict.fromkeys(p for c in classes for p in model.by_type(c))
    for product in wanted:
        bodies = [product]
        if product.Representation is None:
            bodies = [p for p in _parts(product) if not any(p.is_a(c) for c in classes)]
        meshes = [mesh for mesh in map(triangulated, bodies) if mesh is not None]
        if meshes:
            vertices, faces = _joined(meshes)
            name = product.Name or ""
            yield IfcProduct(product.GlobalId, product.is_a(), name, _storey(product), vertices, faces)


def solids(model: ifcopenshell.file, classes: tuple[str, ...]) -> list[Solid]:
    """The bodies of the products of these classes."""
    return [solid_of(p.vertices, p.faces, p.global_id, p.ifc_class, p.storey) for p in products(model, classes)]


def _parts(assembly: ifcopenshell.entity_instance) -> list[ifcopenshell.entity_instance]:
    return [p for part in get_parts(assembly) if part.is_a("IfcProduct") for p in (part, *_parts(part))]


def triangulated(product: ifcopenshell.entity_instance) -> Mesh | None:
    """Vertices (N, 3) metres in the BIM frame and faces (M, 3); None where no surface can be made."""
    if product.Representation is None:
        return None
    try:
        shape = ifcopenshell.geom.create_shape(_settings(), product)
    except RuntimeError:
        return None
    vertices = np.asarray(shape.geometry.verts, dtype=float).reshape(-1, 3)
    faces = np.asarray(shape.geometry.faces, dtype=np.int32).reshape(-1, 3)
    return (vertices, faces) if len(faces) and np.isfinite(vertices).all() else None


def opening_of(filling: ifcopenshell.entity_instance) -> tuple[Mesh | None, str | None]:
    """The body of the opening that a door or window fills, and the GlobalId of what it is cut out of."""
    opening, host = None, None
    for fills in filling.FillsVoids:
        if (filled := fills.RelatingOpeningElement) is None:  # the model refers to what it lacks
            continue
        opening = triangulated(filled)
        wall = filled.VoidsElements[0].RelatingBuildingElement if filled.VoidsElements else None
        host = None if wall is None else str(wall.GlobalId)
    return opening, host


@cache
def _settings() -> ifcopenshell.geom.settings:
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    return settings


def _joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [f + int(start) for (_, f), start in zip(meshes, starts, strict=False)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces).astype(np.int32)


def _storey(product: ifcopenshell.entity_instance | None) -> str | None:
    while product is not None and not product.is_a("IfcBuildingStorey"):
        product = get_container(product) or get_aggregate(product)
    return product.GlobalId if product is not None else None
