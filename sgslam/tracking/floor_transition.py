"""Floor transitions: the sensor rises or sinks, as it is tracked, leaves its floor and arrives on level ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config import FloorSettings
from sgslam.mapping import FloorMap, Floors
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Arrival:
    """Arrival on level ground at `height` (m) above `floor`; None where a new floor begins there.

    `drift` (m) is what the climb may have drifted in height where the floor was known before.
    """

    floor: FloorMap | None
    height: float
    drift: float = 0.0


class FloorTransition(Stateful):
    """Follows the height of the ground under the sensor above its floor.

    `active`: between two floors. `ground` (m): height of the ground under the robot above its floor, on steps or ramps.
    """

    _STATE = ("active", "ground", "_way")

    def __init__(self, settings: FloorSettings) -> None:
        self._settings = settings
        self.active, self.ground = False, 0.0
        self._way: list[Floats] = []  # x, y and height of the ground since the floor was left, level frame

    def follow(self, T_level_sensor: Floats, T_level_map: Floats, height: float, floors: Floors) -> Arrival | None:
        """Adds a pose (4, 4) in the level frame of the present floor; returns the arrival on a floor, if any.

        `height` (m) is the sensor's above the ground.
        """
        settings = self._settings
        here = np.array([*T_level_sensor[:2, 3], T_level_sensor[2, 3] - height])
        if not self.active:
            self.active = abs(here[2] - self.ground) > settings.left
            self._way = [here] if self.active else []
            return None
        self._way.append(here)
        way = np.stack(self._way)
        uneven = np.flatnonzero(np.abs(way[:, 2] - here[2]) > settings.flat)
        since = way[uneven[-1] + 1 :] if len(uneven) else way
        if float(np.linalg.norm(since[:, :2] - here[:2], axis=1).max()) < settings.level_way:
            return None
        return self._arrival(float(np.median(since[:, 2])), float(np.ptp(way[:, 2])), T_level_map, floors)

    def _arrival(self, ground: float, climbed: float, T_level_map: Floats, floors: Floors) -> Arrival:
        """The arrival on ground of this height, after so many metres of climbing."""
        settings = self._settings
        known = {floor.number: _height_of(floor, T_level_map) for floor in floors.maps}
        nearest = min(known, key=lambda number: abs(known[number] - ground))
        above = ground - known[nearest]
        drift = settings.climb_drift * climbed
        if abs(above) < settings.home + drift:
            return Arrival(floors.maps[nearest], 0.0, drift)
        return Arrival(None, ground) if abs(above) > settings.storey else Arrival(floors.maps[nearest], above)

    def end(self, arrival: Arrival) -> None:
        """Ends the transition: the sensor is over level ground again."""
        self.active, self.ground, self._way = False, 0.0 if arrival.floor is None else arrival.height, []


def _height_of(floor: FloorMap, T_level_map: Floats) -> float:
    """Height (m) of a floor above that of `T_level_map` (4, 4); all floors are parallel."""
    return float(T_level_map[2, 3] - floor.walls.T_level_map[2, 3])
