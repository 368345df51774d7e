"""Floor transitions: the sensor rises or sinks, as it is tracked, leaves its floor and arrives on level ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config import FloorSettings
from sgslam.config.sensor import BUILDING, CARRIER
from sgslam.mapping.floors import FloorMap, Floors

Floats = NDArray[np.float64]
_MOST = 1000  # places since the floor was left that are looked at, more than a minute on a landing


@dataclass(frozen=True)
class Arrival:
    """Arrival on level ground at `height` (m) above `floor`; None where a new floor begins there.

    `drift` (m) is what the climb may have drifted in height where the floor was known before.
    """

    floor: FloorMap | None
    height: float
    drift: float = 0.0


class FloorTransition:
    """Follows the height of the ground under the sensor above its floor.

    `active`: between two floors. `ground` (m): height of the ground under the robot above its floor, on steps or ramps.
    `height` (m): the sensor's above the ground; a guess until a floor was seen.
    """

    def __init__(self, settings: FloorSettings, height: float) -> None:
        self._settings, self.height = settings, height
        self.active, self.ground = False, 0.0
        # (N, 3) x, y and height of the ground in the level frame: the newest since the floor was left, as far as they
        # may be level ground; and the extreme heights of all
        self._way: Floats = np.empty((0, 3))
        self._lowest, self._highest = 0.0, 0.0

    def follow(self, T_level_sensor: Floats, T_level_map: Floats, floors: Floors) -> Arrival | None:
        """Adds a pose (4, 4) in the level frame of the present floor; returns the arrival on a floor, if any, which
        ends the transition."""
        here = np.array([*T_level_sensor[:2, 3], T_level_sensor[2, 3] - self.height])
        if not self.active:
            self.active = abs(here[2] - self.ground) > BUILDING.raised
            self._way = here[None]
            self._lowest = self._highest = float(here[2])
            return None
        self._lowest, self._highest = min(self._lowest, float(here[2])), max(self._highest, float(here[2]))
        way = np.vstack([self._way, here])
        back = way[::-1, 2]
        climb = (np.maximum.accumulate(back) - np.minimum.accumulate(back))[::-1]  # from each place to here
        way = way[np.searchsorted(-climb, -2 * BUILDING.uneven) :]
        self._way = way if len(way) <= _MOST else way[::2]
        uneven = np.flatnonzero(np.abs(way[:, 2] - here[2]) > BUILDING.uneven)
        since = way[uneven[-1] + 1 :] if len(uneven) else way
        if float(np.linalg.norm(since[:, :2] - here[:2], axis=1).max()) < BUILDING.landing:
            return None
        arrival = self._arrival(float(np.median(since[:, 2])), self._highest - self._lowest, T_level_map, floors)
        self.active, self.ground = False, 0.0 if arrival.floor is None else arrival.height
        return arrival

    def _arrival(self, ground: float, climbed: float, T_level_map: Floats, floors: Floors) -> Arrival:
        """The arrival on ground of this height, after so many metres of climbing."""
        settings = self._settings
        # all floors are parallel: the heights (m) above that of `T_level_map`
        known = {floor.number: float(T_level_map[2, 3] - floor.walls.T_level_map[2, 3]) for floor in floors.maps}
        nearest = min(known, key=lambda number: abs(known[number] - ground))
        above = ground - known[nearest]
        drift = CARRIER.climb_drift * climbed
        if abs(above) < settings.home + drift:
            return Arrival(floors.maps[nearest], 0.0, drift)
        return Arrival(None, ground) if abs(above) > settings.storey else Arrival(floors.maps[nearest], above)
