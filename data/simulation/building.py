"""The building that is driven, as it was built, and the way through its storeys."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.plans.mesh_files import is_mesh
from data.simulation.changes import Changes
from data.simulation.mesh_storey import mesh_storey
from data.simulation.multi_storey_drive import plan_storeys
from data.simulation.occupancy import Grid
from data.simulation.route import Planner, plan_tour
from data.simulation.stairs import Storey
from data.simulation.storey_model import StoreyModel, load_storey, load_storeys

Grids = dict[StoreyModel, Grid]
TOLERANCE = 0.015  # m, standard deviation of a wall's place


def storeys_as_built(
    ifc: Path | str, storeys: list[str], changes: Changes | None, seed: int, effects: Collection[str]
) -> list[StoreyModel]:
    """Reads the storeys in the order of the drive, with `changes` and the effect `tolerance` made to their walls.

    Raises UserError for a file or storey that cannot be driven, and for changes to several storeys or to a mesh.
    """
    tolerance = TOLERANCE if "tolerance" in effects else 0.0
    if len(storeys) == 1:
        load = mesh_storey if is_mesh(ifc) else load_storey
        return [load(ifc, storeys[0], changes, seed, tolerance)]
    if changes is not None and changes.any:
        raise UserError("walls that stand otherwise than planned: give one storey, not several")
    if is_mesh(ifc):
        raise UserError(f"{ifc}: a mesh has no marked stairs; give one storey, or an IFC file")
    return load_storeys(ifc, storeys, seed, tolerance)


def legs_over(
    models: list[StoreyModel], grids: Grids, scene: TriangleScene, radius: float, min_rooms: int,
    min_length: float, rng: np.random.Generator,
) -> tuple[NDArray[np.float64], ...]:  # fmt: skip
    """The legs of a tour, (N, 2) on one storey, (N, 3) over several; see `tour` and `plan_storeys`."""
    if len(models) == 1:
        return plan_tour(grids[models[0]], radius, min_rooms, min_length, rng)
    of = {model: Storey(model, Planner(grid, radius, rng)) for model, grid in grids.items()}
    return plan_storeys([of[model] for model in models], scene, radius, min_rooms, min_length, rng)
