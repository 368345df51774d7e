"""The committed match of a floor, with its place and its walls."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from matching.result import MatchResult
from sgslam.anchoring.anchor_log import Key
from sgslam.anchoring.wall_alignment import planar_pose
from sgslam.geometry.frames import inverse
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]


class Commitment:
    """The committed match of one floor.

    `match` is None while there is none; `place` (3,) is its T_local_level, yaw x y; `pairs` are its walls and planned
    surfaces. `follows`: the place is that of another floor, with its `other_confidence`. `replaced`: the back end's
    estimate is still that of a match that was withdrawn.
    """

    def __init__(self) -> None:
        self.match: MatchResult | None = None
        self.place: Floats = np.zeros(3)
        self.pairs: set[Key] = set()
        self.follows = False
        self.other_confidence = 0.0
        self.replaced = False

    @property
    def floor(self) -> str | None:
        """The storey of the match; None where there is no match, or it names no storey."""
        return self.match.floor if self.match is not None else None

    @property
    def confidence(self) -> float:
        """The least confidence of the committed wall pairs; that of the other floor where there are none."""
        given = self.match.wall_surfaces if self.match is not None else ()
        return min((c for _, _, c in given), default=self.other_confidence)

    def commit(self, match: MatchResult, place: Floats, scene: Scene) -> None:
        """Commits to a unique match at a place (3,), T_local_level."""
        self.match, self.place, self.follows = match, place, False
        self.pairs = {(scene.wall_of_surface[s], a) for s, a, _ in match.wall_surfaces}

    def clear(self) -> None:
        """Forgets the match."""
        self.match, self.pairs, self.follows = None, set(), False

    def rename(self, current: Callable[[int], int]) -> None:
        """Follows walls that were joined; `current` gives a wall's number now."""
        self.pairs = {(current(wall), a_id) for wall, a_id in self.pairs}

    def place_now(self, walls: WallMap, T_map_local: Floats | None) -> Floats:
        """(3,) T_local_level by the back end's estimate where it is valid, else that of the match."""
        if T_map_local is None or self.replaced:
            return self.place
        return planar_pose(inverse(walls.T_level_map @ T_map_local))
