"""Products as built: shifted or left out; and a plan that lacks walls which stand."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import ifcopenshell
import numpy as np
from ifcopenshell.util.element import get_decomposition

from data.common.files import write_atomically
from data.ifc.products import IfcProduct, open_ifc
from data.simulation.changes.changes import Change


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
