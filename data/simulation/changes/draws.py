"""Which walls and columns of a storey differ from the plan, drawn at random; doors and windows besides."""

import ifcopenshell
import numpy as np

from data.ifc.products import IfcProduct
from data.simulation.changes.changes import MOST, Change, Changes
from data.simulation.changes.opening_draws import across, draw_openings

LEAST = 0.1  # m across, of a moved wall


def draw_changes(
    model: ifcopenshell.file, own: list[IfcProduct], openings: list[IfcProduct], changes: Changes, seed: int
) -> tuple[Change, ...]:
    """Chooses among a storey's `own` products at random, the same for the same seed.

    A wall's shift is across its footprint. `openings` are the IfcOpeningElements, of the whole model if need be; see
    `draw_openings`. A column's shift has any horizontal direction.
    """
    walls, columns = (of_class(model, own, ifc_class) for ifc_class in ("IfcWall", "IfcColumn"))
    drawn = _draw_walls(walls, changes, seed)
    changed = {change.id for change in drawn}
    drawn += draw_openings(model, walls, columns, openings, changed, changes, seed)
    drawn += _draw_columns(columns, changes, seed)
    return tuple(sorted(drawn, key=lambda change: change.id))


def draw_tolerances(walls: list[IfcProduct], tolerance: float, seed: int) -> tuple[Change, ...]:
    """A Gaussian shift of each wall across its footprint, of this standard deviation in metres."""
    rng = np.random.default_rng([seed, 102])
    drawn = []
    for wall in sorted(walls, key=lambda wall: wall.global_id):
        x, y = (rng.normal(0.0, tolerance) * across(wall)).tolist()
        drawn.append(Change(wall.global_id, "moved", (x, y)))
    return tuple(drawn)


def of_class(model: ifcopenshell.file, own: list[IfcProduct], ifc_class: str) -> list[IfcProduct]:
    """Those of a class or its subclasses."""
    return [product for product in own if model.by_guid(product.global_id).is_a(ifc_class)]


def _draw_walls(walls: list[IfcProduct], changes: Changes, seed: int) -> list[Change]:
    rng = np.random.default_rng([seed, 101])
    walls = sorted(walls, key=lambda wall: wall.global_id)
    moved, absent, unplanned = (round(s * len(walls)) for s in (changes.moved, changes.absent, changes.unplanned))
    chosen = [walls[k] for k in rng.permutation(len(walls))]
    drawn = []
    for wall in chosen[:moved]:
        by = rng.uniform(LEAST, MOST)
        by = by if changes.moved_by is None else changes.moved_by
        x, y = (by * rng.choice([-1.0, 1.0]) * across(wall)).tolist()
        drawn.append(Change(wall.global_id, "moved", (x, y)))
    drawn += [Change(wall.global_id, "absent") for wall in chosen[moved : moved + absent]]
    drawn += [Change(wall.global_id, "unplanned") for wall in chosen[moved + absent : moved + absent + unplanned]]
    return drawn


def _draw_columns(columns: list[IfcProduct], changes: Changes, seed: int) -> list[Change]:
    rng = np.random.default_rng([seed, 104])
    columns = sorted(columns, key=lambda column: column.global_id)
    displaced, absent = (round(s * len(columns)) for s in (changes.columns_displaced, changes.columns_absent))
    chosen = [columns[k].global_id for k in rng.permutation(len(columns))]
    drawn = []
    for column in chosen[:displaced]:
        angle = rng.uniform(-np.pi, np.pi)
        x, y = (changes.displaced_by * np.array([np.cos(angle), np.sin(angle)])).tolist()
        drawn.append(Change(column, "displaced", (x, y)))
    return drawn + [Change(column, "absent") for column in chosen[displaced : displaced + absent]]
