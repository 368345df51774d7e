"""Products as built: shifted, left out, or walls cut again with their changed doors and windows; and a plan that lacks
walls which stand."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import ifcopenshell
import numpy as np
from ifcopenshell.api.geometry import edit_object_placement
from ifcopenshell.util.element import get_decomposition
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


def as_built(model: ifcopenshell.file, planned: list[IfcProduct], changes: Iterable[Change]) -> list[IfcProduct]:
    """Returns the products after changes; fillings of a wall's openings move with it, and an opening with the door or
    window that fills it. Gaps at a moved wall's ends stay; walls keep the openings that they have in `planned`."""
    gone, shifts = set[str](), defaultdict[str, list[Array]](list)
    for change in (change for change in changes if change.kind != "unplanned"):
        for key in (change.id, *_follow(model.by_guid(change.id))):
            if change.kind in ("absent", "filled"):
                gone.add(key)
            else:
                shifts[key].append(np.array([*change.offset_in_bim, 0.0]))
    stand = (product for product in planned if product.global_id not in gone)
    return [replace(product, vertices=sum(shifts[product.global_id], product.vertices)) for product in stand]


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


def _follow(changed: ifcopenshell.entity_instance) -> list[str]:
    """GlobalIds of what moves or is left out with a wall, door, window or column."""
    if changed.is_a("IfcWall"):
        return list(fillings(changed))
    return [own.GlobalId for own in (*get_decomposition(changed), *_openings(changed))]


def recut(
    model: ifcopenshell.file, planned: list[IfcProduct], volumes: list[IfcProduct], changes: tuple[Change, ...]
) -> list[IfcProduct]:
    """Returns the products, with the openings of walls where the displaced doors and windows are, and without those of
    the filled ones, which it changes in the model. `volumes` are the IfcOpeningElements.

    Raises UserError where a wall's surface cannot be made so.
    """
    volume_of = {volume.global_id: volume for volume in volumes}
    changed: dict[str, list[tuple[IfcProduct, Change]]] = {}  # the openings of walls, by their GlobalIds
    for change in (change for change in changes if change.kind in ("displaced", "filled")):
        for opening in _openings(model.by_guid(change.id)):
            (voids,) = opening.VoidsElements
            wall = voids.RelatingBuildingElement.GlobalId
            changed.setdefault(wall, []).append((volume_of[opening.GlobalId], change))
            if change.kind == "filled":
                model.remove(voids)
            else:
                _move(model, opening, change.offset_in_bim)
    products = []
    for product in planned:
        if product.global_id in changed:
            mesh = triangulated(model.by_guid(product.global_id))
            if mesh is None:
                raise UserError(f"wall {product.global_id} cannot be cut with its changed openings; give another seed")
            cut = replace(product, vertices=mesh[0], faces=mesh[1])
            product = _closed(cut, product, changed[product.global_id])
        products.append(product)
    return products


def _openings(filling: ifcopenshell.entity_instance) -> list[ifcopenshell.entity_instance]:
    """The opening that a door or window fills; a column has none."""
    return [fills.RelatingOpeningElement for fills in filling.FillsVoids]


def _move(model: ifcopenshell.file, product: ifcopenshell.entity_instance, offset_in_bim: tuple[float, float]) -> None:
    T_bim_product = get_local_placement(product.ObjectPlacement)
    T_bim_product[:2, 3] += np.array(offset_in_bim) / calculate_unit_scale(model)
    edit_object_placement(model, product=product, matrix=T_bim_product, is_si=False)


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
