"""Builds the factors of keyframes, walls, floors, rooms and the BIM.

All factors go into the log. A factor whose measurement and variables did not change is reused.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, P, R, X
from numpy.typing import NDArray

import factors
from sgslam.backend.factor_log import Entry, FactorLog, Key, Kind
from sgslam.backend.variables import BIM, GROUND, IDENTITY, LEVEL, SAME, GraphInputs
from sgslam.config import Config
from sgslam.config.sensor import BUILDING
from sgslam.mapping import SMOOTHED, Anchors, Closure, KeyframeNode, PlannedWall, RoomNode, SeenLevel, SeenWall

Floats = NDArray[np.float64]
_OUTLIER = (
    3.0  # whitened residual beyond which a loop closure counts less, and at which an anchor's weight is a quarter
)
_FREE = 1000.0  # m, of what is not measured


class GraphBuilder:
    """Puts factors into `log`; `keyframes` are those of the back end."""

    def __init__(self, config: Config, keyframes: list[KeyframeNode], log: FactorLog) -> None:
        self._config, self._keyframes, self._log = config, keyframes, log
        self._is_floor: dict[int, bool] = {}  # of each level surface, whether it was seen from above
        self.found: dict[int, Floats] = {}  # T_map_sensor (4, 4) of keyframes to which no odometry leads
        self.begin = np.eye(4)  # T_map_sensor of the first keyframe
        for key, name in ((IDENTITY, "identity"), (SAME, "same")):
            log.add(0, "start", (name,), Entry(_fixed(key, np.eye(4)), "start", "fixed"))

    def hold_begin(self, T_map_sensor: Floats) -> None:
        """Fixes the first keyframe at its pose (4, 4) in the map, which is level there."""
        self.begin = T_map_sensor
        entry = Entry(_fixed(X(0), T_map_sensor), "start", "the map begins at the first keyframe")
        self._log.add(0, "start", ("map",), entry)

    def hold_step(self, i: int, step: Floats) -> None:
        """Adds the odometry's `step` (4, 4) from keyframe i - 1 to keyframe i."""
        keyframe, why = self._keyframes[i], "the step between two keyframes"
        why = f"{why}, poorly constrained by surfaces" if keyframe.weak_step else why
        share = SMOOTHED if keyframe.smoothed else 1.0
        noise = factors.noise_of_covariance(share**2 * keyframe.step_covariance)
        factor = gtsam.BetweenFactorPose3(X(i - 1), X(i), gtsam.Pose3(step), noise)
        self._log.add(i + 1, "odometry", (i,), Entry(factor, "odometry", why))

    def hold_place(self, i: int, T_map_sensor: Floats) -> None:
        """Adds a loose prior (4, 4) of keyframe i, to which no odometry leads; walls constrain it more closely."""
        self.found[i] = T_map_sensor
        prior = gtsam.PriorFactorPose3(X(i), gtsam.Pose3(T_map_sensor), factors.noise_of_pose(0.1, 1.0))
        self._log.add(i + 1, "start", ("found", i), Entry(prior, "match", "the place where the sensor was found again"))

    def _entry(
        self, kind: Kind, key: Key, by: str, why: str, build: Callable[..., gtsam.NonlinearFactor], *arguments: Any
    ) -> dict[Key, Entry]:
        """The factor by its key, as it was held before where it does not change."""
        before = self._log.held(kind).get(key) if kind in ("wall", "level", "loop") else None
        if before is not None and before.factor is not None:
            return {key: before}
        return {key: Entry(build(*arguments), by, why)}

    def hold_walls(self, seen: list[SeenWall]) -> dict[int, int]:
        """Adds the walls seen from two keyframes or more; returns the keyframe in whose frame each is estimated."""
        keyframes_of: dict[int, set[int]] = {}
        for s in seen:
            keyframes_of.setdefault(s.wall, set()).add(s.keyframe)
        anchor_of = {wall: min(k) for wall, k in keyframes_of.items() if len(k) >= 2}
        observations = [(s.wall, s, self._of_wall(s)) for s in seen]
        self._log.hold(
            len(self._keyframes),
            "wall",
            self._observed("wall", P, observations, anchor_of),
            "it belongs to another wall, or the wall is estimated in another keyframe's frame",
        )
        return anchor_of

    def _observed(
        self,
        kind: Literal["wall", "level"],
        symbol: Callable[[int], int],
        seen: Sequence[tuple[int, SeenWall | SeenLevel, tuple[float, float]]],
        anchor_of: dict[int, int],
    ) -> dict[Key, Entry]:
        """The observations of surfaces by number, with lower bounds (rad, m) of their standard deviations."""
        entries, count = dict[Key, Entry](), Counter[int]()  # the latter of each keyframe so far
        for number, s, sigmas in seen:
            key = (s.keyframe, count[s.keyframe], number, anchor_of.get(number, -1))
            count[s.keyframe] += 1
            if number in anchor_of:
                why = f"keyframe {s.keyframe} saw {kind} {number}"
                arguments = s, symbol(number), anchor_of[number], sigmas
                entries |= self._entry(kind, key, f"{kind} extraction", why, self._observation, *arguments)
        return entries

    def _of_wall(self, seen: SeenWall) -> tuple[float, float]:
        """Lower bounds (rad, m) of the standard deviations of an observed wall: what its points err together turns it
        about the middle of the piece that was seen, the more the shorter that is."""
        settings, (first, last) = self._config.backend, seen.ends
        length = max(float(np.linalg.norm(last - first)), 0.1)
        turn = float(np.sqrt(12.0)) * settings.sigma_wall / length
        aside = abs(float((first + last) @ (last - first))) / (2 * length)  # of the middle from abreast of the sensor
        return turn, float(np.hypot(settings.sigma_wall, turn * aside))

    def _plane_noise(self, sigma_normal: float, sigma_offset: float) -> gtsam.noiseModel.Base:
        # with 1.345 a Huber loss keeps 95 % of the precision where errors are normal (Holland and Welsch 1977)
        return factors.noise_of_plane(sigma_normal, sigma_offset, 1.345)

    def _observation(
        self, seen: SeenWall | SeenLevel, plane: int, anchor: int, sigmas: tuple[float, float]
    ) -> gtsam.NonlinearFactor:
        """The factor of an observed plane with lower bounds `sigmas` (rad, m); `anchor` is the keyframe in whose frame
        the variable `plane` is."""
        normal, offset = (float(np.hypot(*s)) for s in zip(sigmas, (seen.sigma_normal, seen.sigma_offset), strict=True))
        frames = (IDENTITY, SAME) if seen.keyframe == anchor else (X(seen.keyframe), X(anchor))
        return factors.observe_plane(seen.plane, *frames, plane, self._plane_noise(normal, offset))

    def hold_levels(self, seen: list[SeenLevel]) -> dict[int, int]:
        """Adds the level surfaces, all of them parallel; returns the keyframe in whose frame each is estimated."""
        anchor_of: dict[int, int] = {}
        sigmas = self._config.backend.sigma_floor_normal, self._config.backend.sigma_floor_offset
        self._is_floor = {s.level: s.is_floor for s in seen}
        for s in seen:
            anchor_of[s.level] = min(s.keyframe, anchor_of.get(s.level, s.keyframe))
        entries = self._observed("level", F, [(s.level, s, sigmas) for s in seen], anchor_of)
        entries |= self._parallel_levels(anchor_of) | self._verticals()
        gone = "it belongs to another level, or that one is estimated in another keyframe's frame"
        self._log.hold(len(self._keyframes), "level", entries, gone)
        return anchor_of

    def _parallel_levels(self, anchor_of: dict[int, int]) -> dict[Key, Entry]:
        """A level frame, loosely at the origin of the map, in which every level surface is level at any height."""
        by, loose = "level extraction", (LEVEL, gtsam.Pose3(), factors.noise_of_pose(1.0, 1.0))
        entries = self._entry("level", ("level",), by, "a frame that all levels share", gtsam.PriorFactorPose3, *loose)
        noise = self._plane_noise(BUILDING.parallel_floors, _FREE)
        for level, anchor in anchor_of.items():
            up = [0.0, 0.0, 1.0 if self._is_floor[level] else -1.0, 0.0]
            factor = factors.observe_plane, up, LEVEL, X(anchor), F(level), noise
            key, why = ("level", level, anchor), "floors and ceilings of a building are parallel"
            entries |= self._entry("level", key, by, why, *factor)
        return entries

    def _verticals(self) -> dict[Key, Entry]:
        """The vertical that the surfaces show at each keyframe: the normal of the ground of the level frame."""
        ground = factors.observe_own_plane, [0.0, 0.0, 1.0, 0.0], IDENTITY, GROUND
        entries = self._entry(
            "level", ("ground",), "front end", "level", *ground, factors.noise_of_plane(1e-4, 1e-3, None)
        )
        for i, keyframe in enumerate(self._keyframes):
            if np.isfinite(keyframe.sigma_up):
                noise = self._plane_noise(keyframe.sigma_up, _FREE)
                factor = factors.observe_plane, [*keyframe.up, 0.0], X(i), LEVEL, GROUND, noise
                entries |= self._entry("level", ("up", i), "front end", "surfaces are upright or level", *factor)
        return entries

    def hold_loops(self, closures: list[Closure]) -> None:
        """Adds loop closures."""
        entries = dict[Key, Entry]()
        for closure in closures:
            key = (closure.later, closure.earlier)
            entries |= self._entry("loop", key, closure.by, closure.why, _loop, closure)
        self._log.hold(len(self._keyframes), "loop", entries, "it is contradicted")

    def hold_rooms(self, rooms: list[RoomNode], anchor_of: dict[int, int]) -> None:
        """Adds rooms with the walls that bound them."""
        noise = self._plane_noise(0.02, 0.03)
        loose = factors.noise_of_pose(10.0, 1000.0)  # height, roll and pitch of a room are given by nothing else
        entries: dict[Key, Entry] = {}
        for room in rooms:
            prior = gtsam.PriorFactorPose3(R(room.id), gtsam.Pose3(room.T_map_room), loose)
            entries[room.id,] = Entry(prior, "free space", "a room was cut")
            for wall, plane in room.walls.items():
                if wall in anchor_of:
                    factor = factors.observe_plane(plane, R(room.id), X(anchor_of[wall]), P(wall), noise)
                    entries[room.id, wall] = Entry(factor, "free space", f"wall {wall} bounds the room")
        self._log.hold(len(self._keyframes), "room", entries, "the rooms were segmented again")

    def hold_anchors(self, inputs: GraphInputs) -> None:
        """Adds the anchors and the BIM frame; nothing where there are none."""
        entries: dict[Key, Entry] = {}
        if (anchors := inputs.anchors) is not None:
            prior = gtsam.PriorFactorPose3(BIM, gtsam.Pose3(anchors.T_map_local), factors.noise_of_pose(1.0, 100.0))
            entries["frame",] = Entry(prior, anchors.by, "a loose prior of the BIM frame")
            for frame, wall, planned in inputs.wall_frames:
                key: Key = ("wall", wall, planned.a_id or str(gtsam.symbolIndex(frame)))
                factor = self._anchor, frame, wall, planned, inputs.anchor_of[wall]
                entries |= self._place(key, planned.by, "a frame near the wall", planned.place, frame)
                entries |= self._entry("anchor", key, planned.by, planned.why, *factor)
            rooms = {room.id for room in inputs.rooms}
            entries |= self._anchored_rooms(anchors, rooms) | self._anchored_levels(inputs, anchors)
        self._log.hold(len(self._keyframes), "anchor", entries, "the anchoring withdrew or changed it")

    def _place(self, key: Key, by: str, why: str, place: Floats, frame: int) -> dict[Key, Entry]:
        return self._entry("anchor", (*key, "place"), by, why, factors.frame_at, place, BIM, frame)

    def directions(self, inputs: GraphInputs) -> Iterator[gtsam.NonlinearFactor]:
        """The anchors of walls by their directions alone, for a graph with anchors that leaves their places to other
        factors."""
        for frame, wall, planned in inputs.wall_frames:
            yield self._anchor(frame, wall, planned, inputs.anchor_of[wall], _FREE)

    def _anchor(
        self, frame: int, wall: int, planned: PlannedWall, anchor: int, sigma_offset: float | None = None
    ) -> gtsam.NonlinearFactor:
        """The anchor of a wall. Its loss redescends: a map that has drifted is pulled back by the walls near their
        places, and then by the next ones; a wall that was built elsewhere hardly pulls."""
        settings = self._config.anchors
        sigmas = settings.sigma_normal, settings.sigma_offset if sigma_offset is None else sigma_offset
        noise = factors.redescending_noise_of_plane(*sigmas, _OUTLIER)
        plane = factors.plane_from(planned.place, planned.plane)
        return factors.anchor_plane(plane, frame, X(anchor), P(wall), noise)

    def _anchored_rooms(self, anchors: Anchors, rooms: set[int]) -> dict[Key, Entry]:
        settings, entries = self._config.anchors, dict[Key, Entry]()
        sigmas, why = (settings.sigma_normal, settings.sigma_room), "two of its walls stand at those of a planned room"
        for room, T_bim_room in anchors.rooms.items():
            if room in rooms:
                factor = factors.anchor_room, T_bim_room, BIM, R(room), *sigmas
                entries |= self._entry("anchor", ("room", room), anchors.by, why, *factor)
        return entries

    def _anchored_levels(self, inputs: GraphInputs, anchors: Anchors) -> dict[Key, Entry]:
        entries, anchor_of = dict[Key, Entry](), inputs.anchor_of_level
        for frame, level, place in inputs.level_frames:
            if level in anchor_of:
                noise = self._plane_noise(self._config.anchors.sigma_normal, anchors.elevations[level][1])
                side = 1.0 if self._is_floor[level] else -1.0
                factor = factors.storey_plane, 0.0, frame, X(anchor_of[level]), F(level), noise, side
                key, why = ("level", level), "the planned height of a floor or ceiling"
                entries |= self._place(key, anchors.by, "a frame on the planned surface", place, frame)
                entries |= self._entry("anchor", key, anchors.by, why, *factor)
        return entries


def _loop(closure: Closure) -> gtsam.NonlinearFactor:
    noise = factors.noise_of_covariance(closure.covariance, _OUTLIER)
    T_earlier_later = gtsam.Pose3(closure.T_earlier_later)
    return gtsam.BetweenFactorPose3(X(closure.earlier), X(closure.later), T_earlier_later, noise)


def _fixed(key: int, pose: Floats) -> gtsam.NonlinearFactor:
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(pose), factors.noise_of_pose(1e-5, 1e-5))
