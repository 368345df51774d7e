"""The entries of deviations.json of a finished map: as built against as planned."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring import WallAlignment
from sgslam.as_built.deviation_entries import Deviation
from sgslam.as_built.deviation_tests import moved_walls, run_deviation_tests
from sgslam.as_built.deviations import Piece
from sgslam.as_built.extra_walls import extra_walls
from sgslam.as_built.filled_openings import filled_openings
from sgslam.as_built.missing_walls import missing_walls
from sgslam.as_built.visibility import wall_visibility
from sgslam.as_built.wall_solids import sides_of, solids_of
from sgslam.config import Config
from sgslam.mapping import KeyframeNode, Scene, WallMap

Floats = NDArray[np.float64]


def deviations(
    pieces: list[Piece], alignment: WallAlignment, scene: Scene, walls: WallMap, keyframes: list[KeyframeNode],
    floor: SceneGraph, origin: Floats, config: Config,
) -> list[Deviation]:  # fmt: skip
    """The walls of a storey that were tested: as planned or moved, missing, or extra.

    `pieces` are the measured walls of `alignment`; `origin` (2,) is the origin of the local frame in the BIM frame.
    """
    sides = [side for surface in floor.wall_surfaces for side in sides_of(surface)]
    solids = solids_of(sides)
    visibility = wall_visibility(floor, sides, keyframes, walls.T_level_map, alignment.place, origin)
    results = run_deviation_tests(pieces, solids, visibility, config)
    found: list[Deviation] = [*moved_walls(pieces, results)]
    found += missing_walls(sides, solids, alignment, pieces, results, visibility, config)
    doors = np.array([door.centroid for door in floor.doors]).reshape(-1, 2)
    found += filled_openings(sides, doors, alignment, scene, walls, origin, config)
    found += extra_walls(scene, walls, keyframes, floor, alignment, origin)
    return found
