"""Builds the factors of keyframes, walls, floors, rooms and the BIM, and of points on planned walls.

A factor whose measurement and variables did not change is reused.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, Literal

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, P, R, V, X
from numpy.typing import NDArray

import factors
from sgslam.backend.held_factors import Factors, HeldFactors, Key, Kind
from sgslam.backend.variables import BIM, GROUND, IDENTITY, LEVEL, SAME, GraphInputs
from sgslam.config import AnchorSettings, Config
from sgslam.config.sensor import BUILDING, SENSOR
from sgslam.geometry.frames import inverse
from sgslam.mapping import Closure, KeyframeNode, PlannedWall, RoomNode, SeenLevel, SeenWall
from sgslam.mapping.wall_points import Faces, WallPoints

Floats = NDArray[np.float64]
_OUTLIER = (
    3.0  # whitened residual beyond which a loop closure counts less, and at which an anchor's weight is a quarter
)
# Times a step's standard deviations after a second pass, along x, y and z of the map; about these it is the other way
# round. Floors and ceilings are seen from everywhere, walls are not: measured 0.4 to 0.9 in plan view, in 16 drives.
_SMOOTHED = np.array([0.6, 0.6, 0.25])
_HUBER = 1.345  # sigma, with which a Huber loss keeps 95 % of the precision of normal errors (Holland and Welsch 1977)
_SMOOTH = 0.001  # m, below which an offset counts as its square
_FREE = 1000.0  # m, of what is not measured


class GraphBuilder:
    """Makes the factors that are `held`; `keyframes` are those of the back end."""

    def __init__(self, config: Config, keyframes: list[KeyframeNode], held: HeldFactors) -> None:
        self._config, self._keyframes, self._held = config, keyframes, held
        self._is_floor: dict[int, bool] = {}  # of each level surface, whether it was seen from above
        self.found: dict[int, Floats] = {}  # T_map_sensor (4, 4) of keyframes to which no odometry leads
        self.begin = np.eye(4)  # T_map_sensor of the first keyframe
        for key, name in ((IDENTITY, "identity"), (SAME, "same")):
            held["start"][name,] = _fixed(key, np.eye(4))

    def hold_begin(self, T_map_sensor: Floats) -> None:
        """Fixes the first keyframe at its pose (4, 4) in the map, which is level there."""
        self.begin = T_map_sensor
        self._held["start"]["map",] = _fixed(X(0), T_map_sensor)

    def hold_step(self, i: int, step: Floats) -> None:
        """Adds the odometry's `step` (4, 4) from keyframe i - 1 to keyframe i."""
        keyframe = self._keyframes[i]
        covariance = keyframe.step_covariance
        if keyframe.smoothed:
            covariance = _smoothed(covariance, keyframe.T_map_sensor[:3, :3])
        noise = factors.noise_of_covariance(covariance)
        self._held["odometry"][i,] = gtsam.BetweenFactorPose3(X(i - 1), X(i), gtsam.Pose3(step), noise)

    def hold_place(self, i: int, T_map_sensor: Floats) -> None:
        """Adds a loose prior (4, 4) of keyframe i, to which no odometry leads; walls constrain it more closely."""
        self.found[i] = T_map_sensor
        noise = factors.noise_of_pose(0.1, 1.0)
        self._held["start"]["found", i] = gtsam.PriorFactorPose3(X(i), gtsam.Pose3(T_map_sensor), noise)

    def _factor(self, kind: Kind, key: Key, build: Callable[..., gtsam.NonlinearFactor], *arguments: Any) -> Factors:
        """The factor by its key, as it was held before where it does not change."""
        before = self._held[kind].get(key) if kind in ("wall", "level", "loop") else None
        return {key: build(*arguments) if before is None else before}

    def hold_walls(self, seen: list[SeenWall]) -> dict[int, int]:
        """Adds the walls seen from two keyframes or more; returns the keyframe in whose frame each is estimated."""
        keyframes_of: dict[int, set[int]] = {}
        for s in seen:
            keyframes_of.setdefault(s.wall, set()).add(s.keyframe)
        anchor_of = {wall: min(k) for wall, k in keyframes_of.items() if len(k) >= 2}
        observations = [(s.wall, s, self._of_wall(s)) for s in seen]
        self._held["wall"] = self._observed("wall", P, observations, anchor_of)
        return anchor_of

    def _observed(
        self,
        kind: Literal["wall", "level"],
        symbol: Callable[[int], int],
        seen: Sequence[tuple[int, SeenWall | SeenLevel, tuple[float, float]]],
        anchor_of: dict[int, int],
    ) -> Factors:
        """The observations of surfaces by number, with lower bounds (rad, m) of their standard deviations."""
        found, count = Factors(), Counter[int]()  # the latter of each keyframe so far
        for number, s, sigmas in seen:
            key = (s.keyframe, count[s.keyframe], number, anchor_of.get(number, -1))
            count[s.keyframe] += 1
            if number in anchor_of:
                arguments = s, symbol(number), anchor_of[number], sigmas
                found |= self._factor(kind, key, self._observation, *arguments)
        return found

    def _of_wall(self, seen: SeenWall) -> tuple[float, float]:
        """Lower bounds (rad, m) of the standard deviations of an observed wall: what its points err together turns it
        about the middle of the piece that was seen, the more the shorter that is."""
        settings, (first, last) = self._config.backend, seen.ends
        length = max(float(np.linalg.norm(last - first)), 0.1)
        turn = float(np.sqrt(12.0)) * settings.sigma_wall / length
        aside = abs(float((first + last) @ (last - first))) / (2 * length)  # of the middle from abreast of the sensor
        return turn, float(np.hypot(settings.sigma_wall, turn * aside))

    def _plane_noise(self, sigma_normal: float, sigma_offset: float) -> gtsam.noiseModel.Base:
        return factors.noise_of_plane(sigma_normal, sigma_offset, _HUBER)

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
        found = self._observed("level", F, [(s.level, s, sigmas) for s in seen], anchor_of)
        self._held["level"] = found | self._parallel_levels(anchor_of) | self._verticals()
        return anchor_of

    def _parallel_levels(self, anchor_of: dict[int, int]) -> Factors:
        """A level frame, loosely at the origin of the map, in which every level surface is level at any height: floors
        and ceilings of a building are parallel."""
        loose = LEVEL, gtsam.Pose3(), factors.noise_of_pose(1.0, 1.0)
        found = self._factor("level", ("level",), gtsam.PriorFactorPose3, *loose)
        noise = self._plane_noise(BUILDING.parallel_floors, _FREE)
        for level, anchor in anchor_of.items():
            up = [0.0, 0.0, 1.0 if self._is_floor[level] else -1.0, 0.0]
            key = ("level", level, anchor)
            found |= self._factor("level", key, factors.observe_plane, up, LEVEL, X(anchor), F(level), noise)
        return found

    def _verticals(self) -> Factors:
        """The vertical that the surfaces show at each keyframe: the normal of the ground of the level frame."""
        ground = [0.0, 0.0, 1.0, 0.0], IDENTITY, GROUND, factors.noise_of_plane(1e-4, 1e-3, None)
        found = self._factor("level", ("ground",), factors.observe_own_plane, *ground)
        for i, keyframe in enumerate(self._keyframes):
            if np.isfinite(keyframe.sigma_up):
                seen = [*keyframe.up, 0.0], X(i), LEVEL, GROUND, self._plane_noise(keyframe.sigma_up, _FREE)
                found |= self._factor("level", ("up", i), factors.observe_plane, *seen)
        return found

    def hold_loops(self, closures: list[Closure]) -> None:
        found = Factors()
        for closure in closures:
            found |= self._factor("loop", (closure.later, closure.earlier), _loop, closure)
        self._held["loop"] = found

    def hold_rooms(self, rooms: list[RoomNode], anchor_of: dict[int, int]) -> None:
        """Holds rooms with the walls that bound them."""
        noise = self._plane_noise(0.02, 0.03)
        loose = factors.noise_of_pose(10.0, 1000.0)  # height, roll and pitch of a room are given by nothing else
        found = self._held["room"] = Factors()
        for room in rooms:
            found[room.id,] = gtsam.PriorFactorPose3(R(room.id), gtsam.Pose3(room.T_map_room), loose)
            for wall, plane in room.walls.items():
                if wall in anchor_of:
                    frames = R(room.id), X(anchor_of[wall])
                    found[room.id, wall] = factors.observe_plane(plane, *frames, P(wall), noise)

    def hold_anchors(self, inputs: GraphInputs) -> None:
        """Holds the anchors and the BIM frame; nothing where there are none."""
        found = self._held["anchor"] = Factors()
        if (anchors := inputs.anchors) is None:
            return
        loose, settings = factors.noise_of_pose(1.0, 100.0), self._config.anchors
        found["frame",] = gtsam.PriorFactorPose3(BIM, gtsam.Pose3(anchors.T_map_local), loose)
        for frame, wall, planned in inputs.wall_frames:
            key: Key = ("wall", wall, planned.a_id or str(gtsam.symbolIndex(frame)))
            found[*key, "place"] = factors.frame_at(planned.place, BIM, frame)
            found[key] = self._anchor(frame, wall, planned, inputs.anchor_of[wall])
        rooms = {room.id for room in inputs.rooms}
        for room, T_bim_room in anchors.rooms.items():
            if room in rooms:
                sigmas = settings.sigma_normal, settings.sigma_room
                found["room", room] = factors.anchor_room(T_bim_room, BIM, R(room), *sigmas)
        for frame, level, place in inputs.level_frames:
            if (anchor := inputs.anchor_of_level.get(level)) is not None:
                noise = self._plane_noise(settings.sigma_normal, anchors.elevations[level][1])
                side = 1.0 if self._is_floor[level] else -1.0
                found["level", level, "place"] = factors.frame_at(place, BIM, frame)
                found["level", level] = factors.storey_plane(0.0, frame, X(anchor), F(level), noise, side)

    def directions(self, inputs: GraphInputs, left_out: Collection[str] = ()) -> Iterator[gtsam.NonlinearFactor]:
        """The anchors of walls by their directions alone, for a graph with anchors that leaves their places to other
        factors; without those to some of the planned surfaces."""
        for frame, wall, planned in inputs.wall_frames:
            if planned.a_id not in left_out:
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


def _smoothed(covariance: Floats, R_map_sensor: Floats) -> Floats:
    """A step's covariance (6, 6), rotation first, in the sensor's axes, after a second pass."""
    share = np.zeros((6, 6))
    about = _SMOOTHED[[2, 2, 0]]
    for own, axes in ((slice(3), about), (slice(3, 6), _SMOOTHED)):
        share[own, own] = R_map_sensor.T * axes @ R_map_sensor
    return np.asarray(share @ covariance @ share.T)


def _loop(closure: Closure) -> gtsam.NonlinearFactor:
    noise = factors.noise_of_covariance(closure.covariance, _OUTLIER)
    T_earlier_later = gtsam.Pose3(closure.T_earlier_later)
    return gtsam.BetweenFactorPose3(X(closure.earlier), X(closure.later), T_earlier_later, noise)


def _fixed(key: int, pose: Floats) -> gtsam.NonlinearFactor:
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(pose), factors.noise_of_pose(1e-5, 1e-5))


def point_factors(
    faces: Faces, seen: WallPoints, values: gtsam.Values, settings: AnchorSettings, weights: Floats
) -> Iterator[gtsam.NonlinearFactor]:
    """A linear factor for each mean of points: n . p + d = the wall's offset V(wall), where p follows the keyframe's
    pose T_map_sensor and T_map_local, both at their `values`. Points of a face in one keyframe share an error;
    the `weights` (N,) of their means divide its variance."""
    sigma = np.hypot(SENSOR.range_noise / np.sqrt(seen.count), settings.sigma_extraction) / np.sqrt(weights)
    for i, (face, keyframe) in enumerate(zip(seen.face.tolist(), seen.keyframe.tolist(), strict=True)):
        T_sensor_bim = values.atPose3(X(keyframe)).inverse().compose(values.atPose3(BIM)).matrix()
        # at the sensor's height: walls are not so plumb that the mean of some points would show the sensor's tilt
        place = np.array([*seen.place[i], inverse(T_sensor_bim)[2, 3]])
        normal = np.array([*faces.normal[face], 0.0])
        there = np.concatenate([np.cross(place, normal), normal])  # of a motion of the BIM frame
        n, p = T_sensor_bim[:3, :3] @ normal, T_sensor_bim[:3, :3] @ place + T_sensor_bim[:3, 3]
        here = np.concatenate([np.cross(p, n), n])  # of a motion of the sensor, in its own axes
        keys = X(keyframe), here[None], BIM, -there[None], V(int(faces.wall[face])), -faces.sign[face : face + 1, None]
        noise = gtsam.noiseModel.Isotropic.Sigma(1, float(sigma[i]))
        yield gtsam.LinearContainerFactor(gtsam.JacobianFactor(*keys, -seen.offset[i : i + 1], noise), values)


def redescending(residual: Floats) -> Floats:
    """The weights (N,) of what may be wrong altogether, by whitened residuals (Geman and McClure 1985)."""
    return np.asarray(1.0 / (1.0 + (residual / _OUTLIER) ** 2) ** 2)


def robust_weights(residual: Floats) -> Floats:
    """The weights (N,) of means of points by their whitened residuals (Huber 1964): some are of a thing in front of the
    wall, or of a glimpse through a door. They do not redescend, since in a distorted map all of them are large."""
    return np.asarray(np.minimum(_HUBER / np.maximum(residual, _HUBER), 1.0))


def offset_priors(walls: list[int], sigma_built: float, offsets: Floats) -> Iterator[gtsam.NonlinearFactor]:
    """The Laplace priors of the offsets of walls, with a standard deviation (m): a Huber loss with a short square.

    Most walls stand as planned, some far from it. The optimum is the least sum of absolute values: a moved wall then
    pulls no more than one that is off by millimetres, and, unlike with redescending losses, there is one optimum. Where
    as many walls are moved as are not, it is wide; so the farther a wall was found off, by `offsets` (m), the less it
    pulls (reweighted l1, Candes, Wakin and Boyd 2008, equation 9).
    """
    sigma = float(np.sqrt(_SMOOTH * sigma_built / np.sqrt(2.0)))
    for wall, offset in zip(walls, offsets.tolist(), strict=True):
        own = sigma * float(np.sqrt(1.0 + abs(offset) / sigma_built))
        loss = gtsam.noiseModel.mEstimator.Huber.Create(_SMOOTH / own)
        noise = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Isotropic.Sigma(1, own))
        yield gtsam.PriorFactorVector(V(wall), np.zeros(1), noise)
