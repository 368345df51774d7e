"""The level surfaces of a floor: associates observations across keyframes, and decides which surface is the floor."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import LevelSettings
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.perception import LevelObservation
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]


@dataclass
class SeenLevel:
    """An observation of a level surface at one keyframe, in the sensor frame; `level` is relabelled when levels are
    joined. The other fields are as in `LevelObservation`."""

    keyframe: int
    level: int
    plane: Floats  # (4,)
    centre: Floats  # (3,)
    area: float
    is_floor: bool
    sigma_normal: float
    sigma_offset: float


class LevelRegister(Stateful):
    """The numbering that the level maps of all floors share: `levels` is the count of numbered ones."""

    _STATE = ("levels",)

    def __init__(self) -> None:
        self.levels = 0

    def number(self) -> int:
        """A new level's number."""
        self.levels += 1
        return self.levels - 1


@dataclass(frozen=True)
class Levels:
    """M level surfaces in the levelled map: `height` (M,) m, `centre` (M, 2), `area` (M,), m2 summed over the keyframes
    that saw it, and whether they were seen from above."""

    ids: NDArray[np.int64]
    height: Floats
    centre: Floats
    area: Floats
    is_floor: NDArray[np.bool_]


class LevelMap(Stateful):
    """The observations `seen` of level surfaces on one storey, and the surfaces that they belong to.

    `planes_in_map` are the present estimates (4,) by number; `drift` (m) is what the map's height may have drifted
    since this storey's floor was last seen.
    """

    _STATE = ("seen", "planes_in_map", "drift", "_places")

    def __init__(self, settings: LevelSettings, register: LevelRegister) -> None:
        self._settings, self._register = settings, register
        self.seen: list[SeenLevel] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.drift = 0.0
        self._places = np.empty((0, 3))  # of the observations' centres in the map, as far as known

    def add(self, keyframe: int, T_map_sensor: Floats, found: list[LevelObservation]) -> None:
        """Adds the observations of a keyframe at a pose (4, 4)."""
        for own in found:
            plane, centre = transform_planes(T_map_sensor, own.plane), transform_points(T_map_sensor, own.centre)
            level = self._nearest(centre, own.is_floor, set(self.planes_in_map), self.drift)
            if level is None:
                level = self._register.number()
                self.planes_in_map[level] = plane
            self.seen.append(
                SeenLevel(
                    keyframe, level, own.plane, own.centre, own.area, own.is_floor, own.sigma_normal, own.sigma_offset
                )
            )  # fmt: skip
            self._places = np.vstack([self._places, centre])
        if any(own.is_floor for own in found):
            self.drift = 0.0

    def _nearest(self, centre: Floats, is_floor: bool, among: set[int], drift: float = 0.0) -> int | None:
        """Of the levels `among`, the one that passes through a point (3,) in the map, or nearest below or above it.

        A floor goes on through doors. The ceilings of two rooms may differ: it must have been seen near by.
        """
        away = np.hypot(*(self._places - centre)[:, :2].T)
        near = np.array([s.is_floor for s in self.seen], bool) == is_floor
        near &= is_floor | (away < self._settings.reach)
        known = {self.seen[k].level for k in np.flatnonzero(near).tolist()}
        planes = {level: self.planes_in_map[level] for level in known & among}
        off = {level: abs(float(plane[:3] @ centre + plane[3])) for level, plane in planes.items()}
        nearest = min(sorted(off), key=lambda level: off[level], default=None)
        step = self._settings.step if is_floor else self._settings.ceiling_step
        return nearest if nearest is not None and off[nearest] < step + drift else None

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
        if self.seen:
            own = np.stack([s.centre for s in self.seen])
            self._places = transform_points(poses[[s.keyframe for s in self.seen]][:, None], own[:, None])[:, 0]
        levels, larger = self.levels(np.eye(4)), set[int]()
        for i in np.argsort(-levels.area, kind="stable").tolist():
            centre = np.array([*levels.centre[i], levels.height[i]])
            same = self._nearest(centre, bool(levels.is_floor[i]), larger)
            if same is None:
                larger.add(int(levels.ids[i]))
            else:
                self._relabel(int(levels.ids[i]), same)

    def _relabel(self, gone: int, kept: int) -> None:
        for s in self.seen:
            if s.level == gone:
                s.level = kept
        del self.planes_in_map[gone]

    def levels(self, T_level_map: Floats) -> Levels:
        """All level surfaces, by the present estimates; `T_level_map` (4, 4) levels the map."""
        ids = np.array(sorted(self.planes_in_map), dtype=np.int64)
        row = {level: k for k, level in enumerate(ids.tolist())}
        owner = np.array([row[s.level] for s in self.seen], dtype=np.int64)
        area = np.array([s.area for s in self.seen])
        places = transform_points(T_level_map, self._places)
        total: Floats = np.bincount(owner, area, len(ids)).astype(np.float64)
        mean = np.column_stack([np.bincount(owner, area * places[:, k], len(ids)) for k in range(3)]) / total[:, None]
        is_floor = np.zeros(len(ids), bool)
        is_floor[owner] = np.array([s.is_floor for s in self.seen], dtype=bool)
        return Levels(ids, mean[:, 2], mean[:, :2], total, is_floor)

    def floor(self) -> int | None:
        """The number of the level that is the floor: the lowest one that was seen from above, unless it is small beside
        another one; None where none was."""
        levels = self.levels(np.eye(4))
        candidates = np.flatnonzero(levels.is_floor)
        if not len(candidates):
            return None
        large = candidates[levels.area[candidates] > self._settings.floor_share * levels.area[candidates].max()]
        return int(levels.ids[large[np.argmin(levels.height[large])]])
