"""How walls, doors, windows and columns of a storey differ from the plan: moved, not built, not planned; at random."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import ifcopenshell
import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.ifc.doors import FILLINGS
from data.ifc.products import IfcProduct
from data.scene_graph.nodes import Xy, xy_of

MOST = 0.3  # m that a wall is moved, or something else displaced
LEAST = 0.1  # m across, of a moved wall
GAP = 0.05  # m between a displaced opening and the wall's end, another opening, or what stands at the wall
AT_FACE = 0.01  # m from a wall's face, within which something stands at it
NICHE = 0.02  # m of a wall's thickness that an opening may leave and still go through it
Array = NDArray[np.float64]
Kind = Literal["moved", "absent", "unplanned", "displaced", "filled"]


@dataclass(frozen=True)
class Changes:
    """The shares of a storey's walls, openings and columns that differ from the plan, 0 to 1 each.

    Of the walls (IfcWall), `moved` are moved across, by `moved_by` metres or by 10 to 30 cm each; `absent` are left
    out, `unplanned` missing in the plan. Of the doors and windows in openings of these walls, `openings_displaced` are
    displaced along their wall; `openings_filled` are absent, and their wall goes on there. Of the columns (IfcColumn),
    `columns_displaced` are displaced in any horizontal direction, `columns_absent` left out. Whatever is displaced is
    so by `displaced_by` metres.
    """

    moved: float = 0.0
    absent: float = 0.0
    unplanned: float = 0.0
    moved_by: float | None = None
    openings_displaced: float = 0.0
    openings_filled: float = 0.0
    columns_displaced: float = 0.0
    columns_absent: float = 0.0
    displaced_by: float = 0.1

    def __post_init__(self) -> None:
        """Raises UserError for impossible shares and distances."""
        if self.moved_by is not None and not 0 < self.moved_by <= MOST:
            raise UserError(f"walls moved by {self.moved_by:g} m: give more than 0, and at most {MOST:g}")
        if not 0 < self.displaced_by <= MOST:
            raise UserError(f"displaced by {self.displaced_by:g} m: give more than 0, and at most {MOST:g}")
        for what, shares in self.shares.items():
            if not (min(shares.values()) >= 0 and sum(shares.values()) <= 1):  # nor NaN
                named = [f"{name} ({share:g})" for name, share in shares.items()]
                raise UserError(f"shares of {', '.join(named[:-1])} and {named[-1]} {what}: give 0 to 1 in all")

    @property
    def shares(self) -> dict[str, dict[Kind, float]]:
        """By kind of element and kind of change."""
        return {
            "walls": {"moved": self.moved, "absent": self.absent, "unplanned": self.unplanned},
            "openings": {"displaced": self.openings_displaced, "filled": self.openings_filled},
            "columns": {"displaced": self.columns_displaced, "absent": self.columns_absent},
        }

    @property
    def any(self) -> bool:
        """Whether anything changes."""
        return any(share for shares in self.shares.values() for share in shares.values())


@dataclass(frozen=True)
class Change:
    """What happened to the wall, door, window or column with this GlobalId.

    Walls are `moved`, `absent` or `unplanned`, doors and windows `displaced` or `filled`, columns `displaced` or
    `absent`. `offset_in_bim` is the shift (x, y) in metres of what is moved or displaced.
    """

    id: str
    kind: Kind
    offset_in_bim: Xy = (0.0, 0.0)


AS_PLANNED = Changes()


def draw_changes(
    model: ifcopenshell.file, own: list[IfcProduct], openings: list[IfcProduct], changes: Changes, seed: int
) -> tuple[Change, ...]:
    """Chooses among a storey's `own` products at random, the same for the same seed.

    A wall's shift is across its footprint, a column's has any horizontal direction. `openings` are the
    IfcOpeningElements, of the whole model if need be; see `_draw_openings`.
    """
    walls, columns = (of_class(model, own, ifc_class) for ifc_class in ("IfcWall", "IfcColumn"))
    of_walls, of_openings, of_columns = (np.random.default_rng([seed, chance]) for chance in (101, 103, 104))

    def aside(wall: IfcProduct) -> Array:
        by = of_walls.uniform(LEAST, MOST)
        by = by if changes.moved_by is None else changes.moved_by
        return by * of_walls.choice([-1.0, 1.0]) * across(wall)

    def anywhere(column: IfcProduct) -> Array:
        angle = of_columns.uniform(-np.pi, np.pi)
        return changes.displaced_by * np.array([np.cos(angle), np.sin(angle)])

    drawn = _drawn(walls, changes.shares["walls"], aside, of_walls)
    changed = {change.id for change in drawn}
    drawn += _draw_openings(model, walls, columns, openings, changed, changes, of_openings)
    drawn += _drawn(columns, changes.shares["columns"], anywhere, of_columns)
    return tuple(sorted(drawn, key=lambda change: change.id))


def draw_tolerances(walls: list[IfcProduct], tolerance: float, seed: int) -> tuple[Change, ...]:
    """A Gaussian shift of each wall across its footprint, of this standard deviation in metres."""
    rng = np.random.default_rng([seed, 102])
    walls = sorted(walls, key=lambda wall: wall.global_id)
    return tuple(Change(w.global_id, "moved", xy_of(rng.normal(0.0, tolerance) * across(w))) for w in walls)


def of_class(model: ifcopenshell.file, own: list[IfcProduct], ifc_class: str) -> list[IfcProduct]:
    """Those of a class or its subclasses."""
    return [product for product in own if model.by_guid(product.global_id).is_a(ifc_class)]


def across(wall: IfcProduct) -> Array:
    """(2,) the unit vector along the shorter side of the smallest rectangle around the footprint."""
    around = shapely.oriented_envelope(shapely.multipoints(wall.vertices[:, :2]))
    corners = np.asarray(around.exterior.coords)
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    return np.asarray(sides[np.argmin(lengths)] / lengths.min())


def _drawn(
    own: list[IfcProduct], shares: Mapping[Kind, float], offset: Callable[[IfcProduct], Array], rng: np.random.Generator
) -> list[Change]:
    """By kind of change a share of the products, by chance; those that stand elsewhere do so by an offset."""
    own = sorted(own, key=lambda product: product.global_id)
    order, drawn = iter(rng.permutation(len(own))), list[Change]()
    for kind, share in shares.items():
        for k in islice(order, round(share * len(own))):
            stands = kind in ("moved", "displaced")
            drawn.append(Change(own[k].global_id, kind, xy_of(offset(own[k])) if stands else (0.0, 0.0)))
    return drawn


Opening = tuple[str, IfcProduct, IfcProduct]  # GlobalId of its door or window, its wall, its own volume


def _draw_openings(
    model: ifcopenshell.file, walls: list[IfcProduct], columns: list[IfcProduct], volumes: list[IfcProduct],
    changed: Collection[str], changes: Changes, rng: np.random.Generator,
) -> list[Change]:  # fmt: skip
    """Chooses doors and windows that alone fill an opening of a storey's `walls`; none in the walls that are `changed`
    (GlobalIds), or made of parts: their openings cut the parts. `volumes` are the IfcOpeningElements.

    A displaced opening stays within its wall, and clear of the wall's other openings, of other walls and of columns.
    Fewer are displaced where too few can be.
    """
    volume_of, openings, stand = {volume.global_id: volume for volume in volumes}, list[Opening](), [*walls, *columns]
    for wall in walls:
        entity = model.by_guid(wall.global_id)
        for hole in (voids.RelatedOpeningElement for voids in entity.HasOpenings):
            if (volume := volume_of.get(hole.GlobalId)) is None:
                continue
            stand.append(volume)
            fillings = [fills.RelatedBuildingElement for fills in hole.HasFillings]
            can_move = (
                entity.Representation and not entity.IsDecomposedBy and hole.ObjectPlacement.is_a("IfcLocalPlacement")
            )
            if can_move and len(fillings) == 1 and any(fillings[0].is_a(c) for c in FILLINGS):
                openings.append((fillings[0].GlobalId, wall, volume))
    displaced, filled = (round(s * len(openings)) for s in (changes.openings_displaced, changes.openings_filled))
    openings = sorted((o for o in openings if o[1].global_id not in changed), key=lambda opening: opening[0])
    in_the_way = {p.global_id: shapely.convex_hull(shapely.multipoints(p.vertices[:, :2])) for p in stand}
    senses = rng.choice([-1.0, 1.0], len(openings))
    drawn, left = list[Change](), list[str]()
    for k in rng.permutation(len(openings)):
        filling, wall, volume = openings[k]
        others = [shape for key, shape in in_the_way.items() if key not in (wall.global_id, volume.global_id)]
        offset = _offset(wall, volume, senses[k] * changes.displaced_by, others) if len(drawn) < displaced else None
        if offset is None:
            left.append(filling)
            continue
        drawn.append(Change(filling, "displaced", offset))
        in_the_way[volume.global_id] = shapely.affinity.translate(in_the_way[volume.global_id], *offset)
    return drawn + [Change(filling, "filled") for filling in left[:filled]]


def _offset(host: IfcProduct, volume: IfcProduct, by: float, others: list[shapely.Geometry]) -> Xy | None:
    """The shift by so many metres along the wall, forward or else back, in the BIM frame; None if `others` stand in
    both ways, and for an opening that does not go straight through its wall."""
    v = across(host)
    axes = np.array([[-v[1], v[0]], v])
    hole, wall = (product.vertices[:, :2] @ axes.T for product in (volume, host))
    (first, front), (last, back) = wall.min(axis=0), wall.max(axis=0)
    if hole[:, 1].min() > front + NICHE or hole[:, 1].max() < back - NICHE:
        return None
    for step in (by, -by):
        edge = hole[:, 0].max() if step > 0 else hole[:, 0].min()
        low, high = sorted((edge, edge + step + np.copysign(GAP, step)))
        corners = np.asarray(shapely.box(low, front - AT_FACE, high, back + AT_FACE).exterior.coords)
        stretch = shapely.Polygon(corners @ axes)
        if first <= low and high <= last and not shapely.intersects(stretch, others).any():
            return xy_of(step * axes[0])
    return None
