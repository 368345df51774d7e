"""Inputs of the back end other than keyframes and walls: rooms, loop closures, and anchors to the BIM."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RoomNode:
    """A room of the S-graph: its pose T_map_room (4, 4) and the walls that bound it, planes (4,) in its frame."""

    id: int
    T_map_room: Floats
    walls: dict[int, Floats]


@dataclass(frozen=True)
class Closure:
    """A loop closure: keyframe `later` revisits the place of keyframe `earlier`.

    T_earlier_later (4, 4) has a covariance (6, 6), rotation first, in the later one's axes. `correction` (m) and `turn`
    (rad) are its correction of the map; `by` is what proposed it, `why` the reason to accept it.
    """

    earlier: int
    later: int
    T_earlier_later: Floats
    covariance: Floats
    correction: float
    turn: float
    by: str
    why: str


@dataclass(frozen=True)
class PlannedWall:
    """A planned plane (4,) and the place (3,) near it where the wall was seen, both in the BIM frame.

    `by` is what paired wall and plane, `why` the reason. `wall` names the planned wall that the plane is a face of,
    empty where that is not known.
    """

    plane: Floats
    place: Floats
    a_id: str = ""
    by: str = "given"
    why: str = ""
    wall: str = ""


@dataclass(frozen=True)
class Anchors:
    """The anchors of the S-graph to the BIM: walls and rooms by number, in a local frame near the building.

    `planes` has all walls that stand near a planned one, whether they agree with it or not.
    """

    T_map_local: Floats
    planes: dict[int, list[PlannedWall]]
    rooms: dict[int, Floats]  # room -> T_bim_room (4, 4)
    elevations: dict[int, tuple[float, float]]  # m, planned heights of level surfaces by number, and their sigmas
    by: str = "given"  # origin of the storey and the rooms
