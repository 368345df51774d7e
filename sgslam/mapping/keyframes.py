"""The inputs of the back end but surfaces: keyframes, and the rule that takes one; rooms, loop closures, anchors."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sgslam.config import KeyframeSettings, OdometrySettings
from sgslam.geometry.frames import angle_of, inverse

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]  # of what there is much of
_STANDING = 50  # scans from keyframe to keyframe while the sensor stands; doubled after each


@dataclass
class KeyframeNode:
    """One keyframe of the S-graph; the back end updates `T_map_sensor` (4, 4), the rest does not change.

    `T_track_sensor` (4, 4) accumulates the tracked motion and never jumps; only differences of it are used. `storey` is
    the number of the S-graph's floor that it was taken on, None on a stair. `step_covariance` (6, 6), rotation first,
    sensor axes, is that of the tracked step to it; `weak_step`: surfaces left some direction of it unconstrained;
    `smoothed`: a second pass has estimated it again. The surfaces show the vertical `up` (3,), in the sensor
    frame, with a standard deviation `sigma_up`.
    """

    scan: int
    stamp_ns: int
    T_track_sensor: Floats
    T_map_sensor: Floats
    outline: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # of free space, sensor frame
    lintels: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # sensor frame
    storey: int | None = 0
    step_covariance: Floats = field(default_factory=lambda: _default_step(OdometrySettings()))
    weak_step: bool = False
    smoothed: bool = False
    up: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    sigma_up: float = np.inf  # rad


def _default_step(settings: OdometrySettings) -> Floats:
    return np.diag(np.repeat([settings.sigma_rotation, settings.sigma_translation], 3) ** 2)


class KeyframeRule:
    """Takes a keyframe by distance, angle, or number of scans."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._settings = settings
        self._last: Floats | None = None
        self._scans = 0
        self._stood = 0  # consecutive keyframes taken while standing still

    def offer(self, T_map_sensor: Floats) -> bool:
        """Offers the scan at this pose (4, 4); returns whether it becomes a keyframe. The first always does."""
        self._scans += 1
        still = False
        if self._last is not None:
            step = inverse(self._last) @ T_map_sensor
            distance = float(np.linalg.norm(step[:3, 3]))
            angle = angle_of(step)
            still = distance < 0.05 and angle < 0.05
            # further keyframes at one place add little: an hour of standing still must not fill the map
            limit = _STANDING << self._stood if still else self._settings.scans
            if distance < self._settings.distance and angle < self._settings.angle and self._scans < limit:
                return False
        self._last, self._scans, self._stood = T_map_sensor, 0, self._stood + 1 if still else 0
        return True


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
    (rad) are its correction of the map; `why` is the reason to accept it.
    """

    earlier: int
    later: int
    T_earlier_later: Floats
    covariance: Floats
    correction: float
    turn: float
    why: str


@dataclass(frozen=True)
class PlannedWall:
    """A planned plane (4,) and the place (3,) near it where the wall was seen, both in the BIM frame.

    `wall` names the planned wall that the plane is a face of, empty where that is not known.
    """

    plane: Floats
    place: Floats
    a_id: str = ""
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


@dataclass(frozen=True, eq=False)
class ControlSight:
    """A control point at `place` (3,) in the plan that a keyframe's sensor has at `in_sensor` (3,), with the standard
    deviation (m) of each coordinate of both together."""

    name: str
    keyframe: int
    in_sensor: Floats
    place: Floats
    sigma: float
