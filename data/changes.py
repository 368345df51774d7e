"""A building that stands otherwise than planned: some of its walls moved, some never built."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import ifcopenshell
import numpy as np
import shapely
from numpy.typing import NDArray

from data.errors import UserError
from data.ifc_products import IfcProduct

LEAST, MOST = 0.1, 0.3  # m across, of a moved wall


@dataclass(frozen=True)
class Changes:
    """The shares of a storey's walls (IfcWall) that are moved by 10 to 30 cm across, either way, or left out."""

    moved: float = 0.0
    absent: float = 0.0

    def __post_init__(self) -> None:
        """Raises UserError for shares that cannot be."""
        if not (0 <= self.moved <= 1 and 0 <= self.absent <= 1 and self.moved + self.absent <= 1):
            raise UserError(f"shares of moved ({self.moved:g}) and absent ({self.absent:g}) walls: give 0 to 1 in all")


@dataclass(frozen=True)
class Change:
    """What became of the wall with this GlobalId; `offset_in_bim` is its shift in plan, metres."""

    id: str
    kind: Literal["moved", "absent"]
    offset_in_bim: tuple[float, float] = (0.0, 0.0)


def draw_changes(walls: list[IfcProduct], changes: Changes, seed: int) -> tuple[Change, ...]:
    """Chooses walls at random, the same for the same seed; a wall's shift is across its footprint."""
    rng = np.random.default_rng([seed, 101])
    walls = sorted(walls, key=lambda wall: wall.global_id)
    moved, absent = (round(share * len(walls)) for share in (changes.moved, changes.absent))
    chosen = [walls[k] for k in rng.permutation(len(walls))[: moved + absent]]
    drawn: list[Change] = []
    for k, wall in enumerate(chosen):
        x, y = (rng.uniform(LEAST, MOST) * rng.choice([-1.0, 1.0]) * _across(wall)).tolist()
        drawn.append(Change(wall.global_id, "moved", (x, y)) if k < moved else Change(wall.global_id, "absent"))
    return tuple(sorted(drawn, key=lambda change: change.id))


def as_built(
    model: ifcopenshell.file, planned: list[IfcProduct], changes: tuple[Change, ...]
) -> list[IfcProduct]:
    """The products after the changes; what fills a wall's openings goes with it. Gaps at a moved wall's ends stay."""
    change_of = {}
    for change in changes:
        change_of.update(dict.fromkeys([change.id, *_fillings(model.by_guid(change.id))], change))
    return [
        _shifted(product, change_of[product.global_id]) if product.global_id in change_of else product
        for product in planned
        if product.global_id not in change_of or change_of[product.global_id].kind != "absent"
    ]


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
