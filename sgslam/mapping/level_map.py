"""The level surfaces of a floor: associates observations across keyframes, and decides which surface is the floor."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import LevelSettings
from sgslam.config.sensor import BUILDING
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.perception import LevelObservation
from sgslam.perception.level_extraction import CELL, middles_of_cells

Floats = NDArray[np.float64]
_FLOOR_SHARE = 0.25  # of the largest level surface seen from above, the least area of the floor


@dataclass
class SeenLevel(LevelObservation):
    """An observation of a level surface at one keyframe, in the sensor frame; `level` is relabelled when levels are
    joined."""

    keyframe: int
    level: int


class Register:
    """The numbering of walls or level surfaces that the maps of all floors share; `count` of them are numbered."""

    def __init__(self) -> None:
        self.count = 0

    def number(self) -> int:
        self.count += 1
        return self.count - 1


@dataclass(frozen=True)
class Levels:
    """M level surfaces in the levelled map: the `places` (C, 3) in plan view where each was seen, the `height` (M,), m,
    that is their mean, the `area` (M,), m2, that they have, and whether they were seen from above."""

    ids: NDArray[np.int64]
    places: tuple[Floats, ...]
    height: Floats
    area: Floats
    is_floor: NDArray[np.bool_]


class LevelMap:
    """The observations `seen` of level surfaces on one storey, and the surfaces that they belong to.

    `planes_in_map` are the present estimates (4,) by number; `drift` (m) is what the map's height may have drifted
    since this storey's floor was last seen.
    """

    def __init__(self, settings: LevelSettings, register: Register) -> None:
        self._settings, self._register = settings, register
        self.seen: list[SeenLevel] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.drift = 0.0
        self._places: dict[int, Floats] = {}  # by number, (C, 3) in the map: one in each cell in which it was seen
        self._floors: set[int] = set()

    def add(self, keyframe: int, T_map_sensor: Floats, found: list[LevelObservation]) -> None:
        """Adds the observations of a keyframe at a pose (4, 4)."""
        for own in found:
            plane, places = transform_planes(T_map_sensor, own.plane), transform_points(T_map_sensor, own.places)
            level = self._nearest(places.mean(axis=0), own.is_floor, set(self.planes_in_map), self.drift)
            if level is None:
                level = self._register.number()
                self.planes_in_map[level] = plane
            self.seen.append(SeenLevel(**vars(own), keyframe=keyframe, level=level))
            self._join(level, places, own.is_floor)
        if any(own.is_floor for own in found):
            self.drift = 0.0

    def _nearest(self, centre: Floats, is_floor: bool, among: set[int], drift: float = 0.0) -> int | None:
        """Of the levels `among`, the one that passes through a point (3,) in the map, or nearest below or above it.

        A floor goes on through doors. The ceilings of two rooms may differ: it must have been seen near by.
        """
        known = self._floors if is_floor else self._ceilings_near(centre)
        planes = {level: self.planes_in_map[level] for level in known & among}
        off = {level: abs(float(plane[:3] @ centre + plane[3])) for level, plane in planes.items()}
        nearest = min(sorted(off), key=lambda level: off[level], default=None)
        step = self._settings.step if is_floor else self._settings.ceiling_step
        return nearest if nearest is not None and off[nearest] < step + drift else None

    def _ceilings_near(self, centre: Floats) -> set[int]:
        """The ceilings that were seen near a point (3,) in the map."""
        ceilings = {level: places for level, places in self._places.items() if level not in self._floors}
        reach = BUILDING.ceiling_reach**2
        return {k for k, places in ceilings.items() if ((places - centre)[:, :2] ** 2).sum(axis=1).min() < reach}

    def _join(self, level: int, places: Floats, is_floor: bool) -> None:
        """Adds places (C, 3) in the map to those where a level was seen."""
        known = self._places.get(level, np.empty((0, 3)))
        self._places[level] = middles_of_cells(np.vstack([known, places]))
        if is_floor:
            self._floors.add(level)

    def absorb(self, other: "LevelMap", keyframes: int, levels: int, T_map_other: Floats) -> None:
        """Adds the observations of another map at `T_map_other` (4, 4), whose keyframes and levels are numbered from
        here on by so many more; `refresh` must follow."""
        for s in other.seen:
            self.seen.append(replace(s, keyframe=s.keyframe + keyframes, level=s.level + levels))
        for level, plane in other.planes_in_map.items():
            self.planes_in_map[level + levels] = transform_planes(T_map_other, plane)

    def refresh(self, planes_in_map: dict[int, Floats], poses: Floats) -> None:
        """Takes over the back end's planes (4,), and joins levels that turn out to be the same; `poses` (K, 4, 4) are
        T_map_sensor of all keyframes."""
        self.planes_in_map = {level: planes_in_map.get(level, plane) for level, plane in self.planes_in_map.items()}
        self._places, self._floors = {}, {s.level for s in self.seen if s.is_floor}
        seen = dict[int, list[Floats]]()
        for s in self.seen:
            seen.setdefault(s.level, []).append(transform_points(poses[s.keyframe], s.places))
        for level, places in seen.items():
            self._places[level] = middles_of_cells(np.vstack(places))
        levels, larger = self.levels(np.eye(4)), set[int]()
        for i in np.argsort(-levels.area, kind="stable").tolist():
            same = self._nearest(levels.places[i].mean(axis=0), bool(levels.is_floor[i]), larger)
            if same is None:
                larger.add(int(levels.ids[i]))
            else:
                self._relabel(int(levels.ids[i]), same)

    def _relabel(self, gone: int, kept: int) -> None:
        for s in self.seen:
            if s.level == gone:
                s.level = kept
        del self.planes_in_map[gone]
        self._join(kept, self._places.pop(gone), gone in self._floors)
        self._floors.discard(gone)

    def levels(self, T_level_map: Floats) -> Levels:
        """All level surfaces, by the present estimates; `T_level_map` (4, 4) levels the map."""
        ids = sorted(self.planes_in_map)
        places = tuple(transform_points(T_level_map, self._places[level]) for level in ids)
        height = np.array([float(own[:, 2].mean()) for own in places])
        area, is_floor = np.array([CELL**2 * len(own) for own in places]), [level in self._floors for level in ids]
        return Levels(np.array(ids, dtype=np.int64), places, height, area, np.array(is_floor, dtype=bool))

    def floor(self) -> int | None:
        """The number of the level that is the floor: the lowest one that was seen from above, unless it is small beside
        another one; None where none was."""
        levels = self.levels(np.eye(4))
        candidates = np.flatnonzero(levels.is_floor)
        if not len(candidates):
            return None
        large = candidates[levels.area[candidates] > _FLOOR_SHARE * levels.area[candidates].max()]
        return int(levels.ids[large[np.argmin(levels.height[large])]])
