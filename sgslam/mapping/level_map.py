"""The level surfaces of a floor: associates observations across keyframes, and decides which surface is the floor."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import LevelSettings
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.perception import LevelObservation
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_CELLS = 8  # within `LevelSettings.reach`: one observation of a ceiling counts in each, so that no more are compared


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

    _STATE = ("seen", "planes_in_map", "drift", "_sums", "_ceilings")

    def __init__(self, settings: LevelSettings, register: LevelRegister) -> None:
        self._settings, self._register = settings, register
        self.seen: list[SeenLevel] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.drift = 0.0
        # by number: the area, the sums of area times x, y and z of the centres in the map, and 1 for a floor
        self._sums: dict[int, Floats] = {}
        self._ceilings: dict[tuple[int, int], dict[int, Floats]] = {}  # by cell and number, a centre in the map

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
            self._count(level, centre, own.area, own.is_floor)
        if any(own.is_floor for own in found):
            self.drift = 0.0

    def _nearest(self, centre: Floats, is_floor: bool, among: set[int], drift: float = 0.0) -> int | None:
        """Of the levels `among`, the one that passes through a point (3,) in the map, or nearest below or above it.

        A floor goes on through doors. The ceilings of two rooms may differ: it must have been seen near by.
        """
        known = {level for level, own in self._sums.items() if own[4]} if is_floor else self._ceilings_near(centre)
        planes = {level: self.planes_in_map[level] for level in known & among}
        off = {level: abs(float(plane[:3] @ centre + plane[3])) for level, plane in planes.items()}
        nearest = min(sorted(off), key=lambda level: off[level], default=None)
        step = self._settings.step if is_floor else self._settings.ceiling_step
        return nearest if nearest is not None and off[nearest] < step + drift else None

    def _ceilings_near(self, centre: Floats) -> set[int]:
        """The ceilings that were seen near a point (3,) in the map."""
        i, j = self._cell(centre)
        around = ((i + di, j + dj) for di in range(-_CELLS, _CELLS + 1) for dj in range(-_CELLS, _CELLS + 1))
        seen = ((level, place) for cell in around for level, place in self._ceilings.get(cell, {}).items())
        reach = self._settings.reach
        return {level for level, place in seen if np.hypot(place[0] - centre[0], place[1] - centre[1]) < reach}

    def _cell(self, place: Floats) -> tuple[int, int]:
        side = self._settings.reach / _CELLS
        return int(place[0] // side), int(place[1] // side)

    def _count(self, level: int, centre: Floats, area: float, is_floor: bool) -> None:
        """Adds an observation of a level at a centre (3,) in the map to what is known of that level."""
        own = np.array([area, *(area * centre), is_floor])
        self._sums[level] = own if level not in self._sums else np.append((self._sums[level] + own)[:4], is_floor)
        if not is_floor:
            self._ceilings.setdefault(self._cell(centre), {}).setdefault(level, centre)

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
        self._sums, self._ceilings = {}, {}
        if self.seen:
            own = np.stack([s.centre for s in self.seen])
            places = transform_points(poses[[s.keyframe for s in self.seen]][:, None], own[:, None])[:, 0]
            for s, place in zip(self.seen, places, strict=True):
                self._count(s.level, place, s.area, s.is_floor)
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
        sums = self._sums.pop(gone)
        self._sums[kept][:4] += sums[:4]
        for seen in self._ceilings.values():
            if gone in seen:
                seen.setdefault(kept, seen.pop(gone))

    def levels(self, T_level_map: Floats) -> Levels:
        """All level surfaces, by the present estimates; `T_level_map` (4, 4) levels the map."""
        ids = np.array(sorted(self.planes_in_map), dtype=np.int64)
        sums = np.array([self._sums[level] for level in ids.tolist()]).reshape(-1, 5)
        mean = transform_points(T_level_map, sums[:, 1:4] / sums[:, :1])
        return Levels(ids, mean[:, 2], mean[:, :2], sums[:, 0], sums[:, 4] > 0)

    def floor(self) -> int | None:
        """The number of the level that is the floor: the lowest one that was seen from above, unless it is small beside
        another one; None where none was."""
        levels = self.levels(np.eye(4))
        candidates = np.flatnonzero(levels.is_floor)
        if not len(candidates):
            return None
        large = candidates[levels.area[candidates] > self._settings.floor_share * levels.area[candidates].max()]
        return int(levels.ids[large[np.argmin(levels.height[large])]])
