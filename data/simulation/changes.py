"""A building that differs from its plan: some walls moved, some not built, some not planned."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import ifcopenshell
import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically
from data.ifc.products import IfcProduct, open_ifc

LEAST, MOST = 0.1, 0.3  # m across, of a moved wall


@dataclass(frozen=True)
class Changes:
    """The shares of a storey's walls (IfcWall) that are moved across, left out, or missing in the plan.

    Moved walls are off by `moved_by` metres, or by 10 to 30 cm each.
    """

    moved: float = 0.0
    absent: float = 0.0
    unplanned: float = 0.0
    moved_by: float | None = None

    def __post_init__(self) -> None:
        """Raises UserError for impossible shares and distances."""
        if self.moved_by is not None and not 0 < self.moved_by <= MOST:
            raise UserError(f"walls moved by {self.moved_by:g} m: give more than 0, and at most {MOST:g}")
        shares = (self.moved, self.absent, self.unplanned)
        if not (min(shares) >= 0 and sum(shares) <= 1):
            message = f"moved ({self.moved:g}), absent ({self.absent:g}) and unplanned ({self.unplanned:g})"
            raise UserError(f"shares of {message} walls: give 0 to 1 in all")

    @property
    def any(self) -> bool:
        """Whether anything changes."""
        return bool(self.moved or self.absent or self.unplanned)


@dataclass(frozen=True)
class Change:
    """What happened to the wall with this GlobalId; `offset_in_bim` is its shift (x, y) in metres."""

    id: str
    kind: Literal["moved", "absent", "unplanned"]
    offset_in_bim: tuple[float, float] = (0.0, 0.0)


def draw_changes(walls: list[IfcProduct], changes: Changes, seed: int) -> tuple[Change, ...]:
    """Chooses walls at random, the same for the same seed; a wall's shift is across its footprint."""
    rng = np.random.default_rng([seed, 101])
    walls = sorted(walls, key=lambda wall: wall.global_id)
    moved, absent, unplanned = (round(s * len(walls)) for s in (changes.moved, changes.absent, changes.unplanned))
    chosen = [walls[k] for k in rng.permutation(len(walls))]
    drawn = []
    for wall in chosen[:moved]:
        by = rng.uniform(LEAST, MOST)
        by = by if changes.moved_by is None else changes.moved_by
        x, y = (by * rng.choice([-1.0, 1.0]) * _across(wall)).tolist()
        drawn.append(Change(wall.global_id, "moved", (x, y)))
    drawn += [Change(wall.global_id, "absent") for wall in chosen[moved : moved + absent]]
    drawn += [Change(wall.global_id, "unplanned") for wall in chosen[moved + absent : moved + absent + unplanned]]
    return tuple(sorted(drawn, key=lambda change: change.id))


def draw_tolerances(walls: list[IfcProduct], tolerance: float, seed: int) -> tuple[Change, ...]:
    """A Gaussian shift of each wall across its footprint, of this standard deviation in metres."""
    rng = np.random.default_rng([seed, 102])
    drawn = []
    for wall in sorted(walls, key=lambda wall: wall.global_id):
        x, y = (rng.normal(0.0, tolerance) * _across(wall)).tolist()
        drawn.append(Change(wall.global_id, "moved", (x, y)))
    return tuple(drawn)


def as_built(
    model: ifcopenshell.file, planned: list[IfcProduct], changes: tuple[Change, ...]
) -> list[IfcProduct]:
    """Returns the products after the changes; fillings of a wall's openings move with it. Gaps at a moved wall's
    ends stay.
    """
    change_of = {}
    for change in (change for change in changes if change.kind != "unplanned"):
        change_of.update(dict.fromkeys([change.id, *_fillings(model.by_guid(change.id))], change))
    return [
        _shifted(product, change_of[product.global_id]) if product.global_id in change_of else product
        for product in planned
        if product.global_id not in change_of or change_of[product.global_id].kind != "absent"
    ]


def write_plan_without(ifc: Path | str, walls: Collection[str], path: Path | str) -> None:
    """Writes the model without these walls (GlobalIds), and without what fills their openings.

    Raises UserError for a file that is not IFC.
    """
    import ifcopenshell.api.root

    model = open_ifc(ifc)
    for wall in sorted(walls):
        for gone in [*_fillings(model.by_guid(wall)), wall]:
            ifcopenshell.api.root.remove_product(model, product=model.by_guid(gone))
    write_atomically(path, model.to_string())


def _shifted(product: IfcProduct, change: Change) -> IfcProduct:
    return replace(product, vertices=product.vertices + np.array([*change.offset_in_bim, 0.0]))


def _fillings(wall: ifcopenshell.entity_instance) -> Iterator[str]:
    """GlobalIds of the doors and windows in a wall."""
    for voids in wall.HasOpenings:
        for fills in voids.RelatedOpeningElement.HasFillings:
            yield fills.RelatedBuildingElement.GlobalId


def _across(wall: IfcProduct) -> NDArray[np.float64]:
    """(2,) the unit vector along the shorter side of the smallest rectangle around the footprint."""
    around = shapely.oriented_envelope(shapely.multipoints(wall.vertices[:, :2]))
    corners = np.asarray(around.exterior.coords)
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    return np.asarray(sides[np.argmin(lengths)] / lengths.min())
