"""The building that is driven, as it was built, and the way through its storeys."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.plans.mesh_files import is_mesh
from data.simulation.changes import Changes
from data.simulation.drive import Robot
from data.simulation.effects.platforms import Platforms, platforms
from data.simulation.mesh_storey import mesh_storey
from data.simulation.multi_storey_drive import plan_storeys
from data.simulation.occupancy import Grid, build_grid
from data.simulation.route import Planner, plan_tour
from data.simulation.stairs import Storey
from data.simulation.storey_model import StoreyModel, load_storey, load_storeys

Grids = dict[StoreyModel, Grid]
TOLERANCE = 0.015  # m, standard deviation of a wall's place


def storeys_as_built(
    ifc: Path | str, storeys: list[str], changes: Changes | None, seed: int, effects: Collection[str]
) -> list[StoreyModel]:
    """Reads the storeys in the order of the drive, with `changes`, and with the effect `tolerance` on their walls.

    Raises UserError for a file or storey that cannot be driven, and for changes to several storeys or to a mesh.
    """
    tolerance = TOLERANCE if "tolerance" in effects else 0.0
    if len(storeys) == 1:
        load = mesh_storey if is_mesh(ifc) else load_storey
        return [load(ifc, storeys[0], changes, seed, tolerance)]
    if changes is not None and changes.any:
        raise UserError("changes to the building need a drive on one storey; give one storey")
    if is_mesh(ifc):
        raise UserError(f"{ifc}: a mesh has no marked stairs; give one storey, or an IFC file")
    return load_storeys(ifc, storeys, seed, tolerance)


@dataclass(frozen=True, eq=False)
class Way:
    """The way through a building: its surfaces, the floor of each storey, the `legs` of the tour, (N, 2) on one storey,
    (N, 3) over several, the heading at the start (rad), and the floors that are `raised`, None without any."""

    scene: TriangleScene
    grids: Grids
    legs: tuple[NDArray[np.float64], ...]
    start_yaw: float
    raised: Platforms | None


def way_through(
    models: list[StoreyModel], top: float, robot: Robot, min_rooms: int, min_length: float, and_back: bool,
    has_steps: bool, seed: int,
) -> Way:  # fmt: skip
    """A random tour of the storeys, in their order, below `top` (m above the floor); see `plan_tour`, `plan_storeys`.

    Raises UserError where the robot cannot move, or cannot climb from storey to storey.
    """
    own = list(dict.fromkeys(models))
    scene = TriangleScene(np.concatenate([model.solid for model in own]))
    grids = {model: build_grid(model, scene, top) for model in own}
    rng = np.random.default_rng(seed)
    start_yaw = float(rng.uniform(-np.pi, np.pi))
    if len(models) == 1:
        legs = plan_tour(grids[models[0]], robot.radius, min_rooms, min_length, rng)
    else:
        of = {model: Storey(model, Planner(grid, robot.radius, rng)) for model, grid in grids.items()}
        legs = plan_storeys([of[model] for model in models], scene, robot.radius, min_rooms, min_length, rng)
    if and_back:
        legs = (*legs, *(leg[::-1] for leg in reversed(legs)))
    raised = platforms(models, legs, scene, seed) if has_steps else None
    if raised is not None:
        legs = tuple(raised.over(leg, models[0].level) for leg in legs)
    return Way(scene, grids, legs, start_yaw, raised)
