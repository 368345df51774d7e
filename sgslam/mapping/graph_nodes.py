"""What the back end is told of, beside keyframes and walls: rooms, and what ties the map to the BIM."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RoomNode:
    """A room of the S-graph as a pose with the walls that bound it, planes (4,) in the room's frame."""

    id: int
    T_map_room: Floats
    walls: dict[int, Floats]


@dataclass(frozen=True)
class Closure:
    """Keyframe `later` saw the place of keyframe `earlier` again: T_earlier_later (4, 4), its covariance (6, 6),
    rotation first, in the later one's axes; `correction` (m) and `turn` (rad) are what it moves the map by; what
    proposed it (`by`), and why it is believed."""

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
    """A planned plane (4,) and the place (3,) near it where the wall was seen, both in the BIM frame; what paired them
    (`by`), and why it holds as it does."""

    plane: Floats
    place: Floats
    a_id: str = ""
    by: str = "given"
    why: str = ""


@dataclass(frozen=True)
class Anchors:
    """What ties the S-graph to the BIM: walls and rooms by their numbers, the BIM frame near the building."""

    T_map_bim: Floats
    planes: dict[int, list[PlannedWall]]
    rooms: dict[int, Floats]  # room -> T_bim_room (4, 4)
    elevations: dict[int, float]  # of the S-graph's floors by their numbers, as far as their storeys are known
    loose: dict[int, list[PlannedWall]] = field(default_factory=dict)  # as `planes`: walls that stand otherwise
    drifted: dict[int, list[PlannedWall]] = field(
        default_factory=dict
    )  # as `planes`: where the map is to be pulled back
    by: str = "given"  # what the storey and the rooms were told by
