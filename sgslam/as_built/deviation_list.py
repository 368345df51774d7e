"""As built against as planned, of a finished map: the entries of deviations.json."""


import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring.wall_alignment import Holding
from sgslam.as_built.deviation_entries import Deviation
from sgslam.as_built.deviation_tests import moved, verdicts
from sgslam.as_built.deviations import Piece
from sgslam.as_built.filled_openings import filled_openings
from sgslam.as_built.missing_and_extra_walls import absent, extra
from sgslam.as_built.visibility import sights_of
from sgslam.as_built.wall_solids import bodies_of, sides_of
from sgslam.config import Config
from sgslam.mapping.keyframes import KeyframeNode
from sgslam.mapping.scene import Scene
from sgslam.mapping.wall_map import WallMap

Floats = NDArray[np.float64]


def deviations(
    pieces: list[Piece], holding: Holding, scene: Scene, walls: WallMap, keyframes: list[KeyframeNode],
    floor: SceneGraph, origin: Floats, config: Config,
) -> list[Deviation]:  # fmt: skip
    """What of a storey's walls is known to stand as planned or moved, is absent, or is extra.

    `pieces` are the measured walls of `holding`; `origin` (2,) is where the local frame lies in the BIM's.
    """
    sides = [side for surface in floor.wall_surfaces for side in sides_of(surface)]
    bodies = bodies_of(sides)
    sights = sights_of(floor, sides, keyframes, walls.T_level_map, holding.place, origin)
    judged = verdicts(pieces, bodies, sights, config)
    found: list[Deviation] = [*moved(pieces, judged)]
    found += absent(sides, bodies, holding, pieces, judged, sights, config)
    doors = np.array([door.centroid for door in floor.doors]).reshape(-1, 2)
    found += filled_openings(sides, doors, holding, scene, walls, origin, config)
    found += extra(scene, walls, floor, holding, origin)
    return found
