"""Products as built: shifted, left out, or walls cut again with their changed doors and windows; and a plan that lacks
walls which stand."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import ifcopenshell
import numpy as np
from ifcopenshell.util.element import copy, get_decomposition
from ifcopenshell.util.placement import get_local_placement
from ifcopenshell.util.unit import calculate_unit_scale
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically
from data.geometry.raycast import BOX_FACES, TriangleScene
from data.ifc.products import IfcProduct, open_ifc, triangulated
from data.simulation.changes import Change, across

Array = NDArray[np.float64]
BEFORE = 0.1  # m in front of a wall, where a ray begins


def as_built(model: ifcopenshell.file, planned: list[IfcProduct], changes: tuple[Change, ...]) -> list[IfcProduct]:
    """Returns the products after the changes; fillings of a wall's openings move with it, and an opening with the door
    or window that fills it. Gaps at a moved wall's ends stay; walls keep the openings that they have in `planned`.
    """
    change_of = {}
    for change in (change for change in changes if change.kind != "unplanned"):
        change_of.update(dict.fromkeys([change.id, *_follow(model.by_guid(change.id))], change))
    return [
        _shifted(product, change_of[product.global_id]) if product.global_id in change_of else product
        for product in planned
        if product.global_id not in change_of or change_of[product.global_id].kind not in ("absent", "filled")
    ]


def write_plan_without(ifc: Path | str, walls: Collection[str], path: Path | str) -> None:
    """Writes the model without these walls (GlobalIds), and without what fills their openings.

    Raises UserError for a file that is not IFC.
    """
    import ifcopenshell.api.root

    model = open_ifc(ifc)
    for wall in sorted(walls):
        for gone in [*fillings(model.by_guid(wall)), wall]:
            ifcopenshell.api.root.remove_product(model, product=model.by_guid(gone))
    write_atomically(path, model.to_string())


def fillings(wall: ifcopenshell.entity_instance) -> Iterator[str]:
    """GlobalIds of the doors and windows in an IfcWall."""
    for voids in wall.HasOpenings:
        for fills in voids.RelatedOpeningElement.HasFillings:
            yield fills.RelatedBuildingElement.GlobalId


def _shifted(product: IfcProduct, change: Change) -> IfcProduct:
    return replace(product, vertices=product.vertices + np.array([*change.offset_in_bim, 0.0]))


def _follow(changed: ifcopenshell.entity_instance) -> Iterator[str]:
    """GlobalIds of what moves or is left out with a wall, door, window or column."""
    if changed.is_a("IfcWall"):
        yield from fillings(changed)
        return
    for part in get_decomposition(changed):
        yield part.GlobalId
    for fills in changed.FillsVoids:
        yield fills.RelatingOpeningElement.GlobalId


def recut(
    model: ifcopenshell.file, planned: list[IfcProduct], volumes: list[IfcProduct], changes: tuple[Change, ...]
) -> list[IfcProduct]:
    """Returns the products, with the openings of walls where the displaced doors and windows are, and without those of
    the filled ones. The model stays as it is. `volumes` are the IfcOpeningElements.

    Raises UserError where a wall's surface cannot be made so.
    """
    opening_of = _openings(model, changes)
    if not opening_of:
        return planned
    edited = ifcopenshell.file.from_string(model.to_string())
    hosts: dict[str, list[Change]] = {}
    for change, opening in opening_of.items():
        hosts.setdefault(_edited(edited, opening, change), []).append(change)
    volume_of = {volume.global_id: volume for volume in volumes}
    products = []
    for product in planned:
        if product.global_id in hosts:
            own = [(volume_of[opening_of[change]], change) for change in hosts[product.global_id]]
            product = _closed(_triangulated(edited, product), product, own)
        products.append(product)
    return products


def _openings(model: ifcopenshell.file, changes: tuple[Change, ...]) -> dict[Change, str]:
    """The changes of doors and windows, and the GlobalIds of their openings."""
    found = {}
    for change in changes:
        if change.kind in ("displaced", "filled"):
            for fills in model.by_guid(change.id).FillsVoids:  # a column has none
                found[change] = fills.RelatingOpeningElement.GlobalId
    return found


def _edited(model: ifcopenshell.file, opening: str, change: Change) -> str:
    """Moves the opening, or removes it from its wall; returns the wall's GlobalId."""
    entity = model.by_guid(opening)
    voids = entity.VoidsElements[0]
    host = str(voids.RelatingBuildingElement.GlobalId)
    if change.kind == "filled":
        model.remove(voids)
    else:
        _move(model, entity, change.offset_in_bim)
    return host


def _move(model: ifcopenshell.file, product: ifcopenshell.entity_instance, offset_in_bim: tuple[float, float]) -> None:
    """Gives the product a placement of its own: others may share the old one, or its axes or its point."""
    old = product.ObjectPlacement
    parent = np.eye(4) if old.PlacementRelTo is None else get_local_placement(old.PlacementRelTo)
    shift = parent[:3, :3].T @ [*offset_in_bim, 0.0] / calculate_unit_scale(model)
    axes = copy(model, old.RelativePlacement)
    place = np.array(axes.Location.Coordinates) + shift
    axes.Location = model.create_entity("IfcCartesianPoint", place.tolist())
    product.ObjectPlacement = model.create_entity("IfcLocalPlacement", old.PlacementRelTo, axes)


def _triangulated(model: ifcopenshell.file, wall: IfcProduct) -> IfcProduct:
    mesh = triangulated(model.by_guid(wall.global_id))
    if mesh is None:
        raise UserError(f"wall {wall.global_id} cannot be cut with its changed openings; give another seed")
    return replace(wall, vertices=mesh[0], faces=mesh[1])


def _closed(wall: IfcProduct, planned: IfcProduct, changed: list[tuple[IfcProduct, Change]]) -> IfcProduct:
    """The wall with its old holes closed. Some models have them in the wall's own shape too, besides the openings."""
    v = across(planned)
    axes = np.array([[v[1], -v[0], 0.0], [v[0], v[1], 0.0], [0.0, 0.0, 1.0]])  # along, across, up
    within = planned.vertices @ axes.T
    for volume, change in changed:
        hole = volume.vertices @ axes.T
        low, high = np.maximum(hole.min(axis=0), within.min(axis=0)), np.minimum(hole.max(axis=0), within.max(axis=0))
        step = float(axes[0, :2] @ change.offset_in_bim)
        if change.kind == "displaced" and step > 0:
            high[0] = low[0] + step
        elif change.kind == "displaced":
            low[0] = high[0] + step
        if _is_open(wall, low, high, axes):
            corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T @ axes
            faces = np.concatenate([wall.faces, BOX_FACES + len(wall.vertices)]).astype(np.int32)
            wall = replace(wall, vertices=np.concatenate([wall.vertices, corners]), faces=faces)
    return wall


def _is_open(wall: IfcProduct, low: Array, high: Array, axes: Array) -> bool:
    """Whether a ray goes through the wall in the middle of the box between two corners (3,), given in the axes."""
    start = (low + high) / 2
    start[1] = low[1] - BEFORE
    met = TriangleScene(wall.triangles).distances(start @ axes, axes[1:2])[0]
    return bool(met > BEFORE + high[1] - low[1])
