"""What a robot measured in two rooms whose truth is known, with a back end that is fed with it."""

from dataclasses import replace

import numpy as np
from boxes import Array, pose
from scipy.spatial.transform import Rotation

from sgslam.backend import Backend
from sgslam.config import Config
from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.geometry.trajectory_errors import align_se3
from sgslam.mapping import Anchors, KeyframeNode, PlannedWall, RoomNode, SeenLevel, SeenWall

# two rooms side by side, x 0 to 6 and 6.2 to 12; inward normals, in a frame whose floor is z = 0
WALLS = np.array([[1.0, 0, 0, 0], [-1, 0, 0, 6], [0, 1, 0, 0], [0, -1, 0, 8], [1, 0, 0, -6.2], [-1, 0, 0, 12]])
MIDDLES = np.array([[0, 4, 1], [6, 4, 1], [6, 0, 1], [6, 8, 1], [6.2, 4, 1], [12, 4, 1]], dtype=float)  # of the walls
FLOOR = np.array([0, 0, 1.0, 0])
HEIGHT = 0.8
CONFIG = Config()
STEP = np.diag([0.01] * 3 + [0.04] * 3) ** 2  # covariance, as the steps slip here


def way(count: int, rounds: int = 2) -> Array:
    """(count, 4, 4) poses of a sensor that drives an oval through both rooms; the first is not at the origin."""
    angle = np.linspace(0, 2 * np.pi * rounds, count)
    x, y = 6 + 4.5 * np.cos(angle), 4 + 2.5 * np.sin(angle)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return np.stack([pose(*place) for place in zip(x, y, np.full(count, HEIGHT), yaw, strict=True)])


def visible(T: Array) -> list[int]:
    """The walls of the room that a pose (in the building's frame) is in."""
    return [0, 1, 2, 3] if T[0, 3] < 6.1 else [2, 3, 4, 5]


def _ends(plane: Array) -> Array:
    """(2, 3) the ends of a piece of 5 m of an upright wall (4,), abreast of the sensor."""
    along = np.cross(plane[:3], [0.0, 0.0, 1.0])
    return np.array([-plane[3] * plane[:3] + step * along for step in (-2.5, 2.5)])


class Run:
    """What a robot measured: `truth` are poses in its first sensor's frame, the map."""

    def __init__(self, count: int = 60, seed: int = 0, outliers: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.in_building = way(count)
        self.T_building_map = self.in_building[0]
        self.truth = inverse(self.T_building_map) @ self.in_building
        self.backend = Backend(CONFIG)
        self.seen: list[SeenWall] = []
        self.levels: list[SeenLevel] = []
        T_odom = np.eye(4)
        for i, T in enumerate(self.truth):
            if i:
                T_odom = T_odom @ self._slipped(inverse(self.truth[i - 1]) @ T)
            floor = self._noisy(self._in_sensor(FLOOR, i))
            self.levels.append(SeenLevel(floor, -floor[3] * floor[None, :3], True, 0.001, 0.003, i, 0))
            self.backend.add_keyframe(KeyframeNode(i, 10**8 * i, T_odom, T_odom.copy(), step_covariance=STEP))
            for wall in visible(self.in_building[i]):
                plane = self._noisy(self._in_sensor(WALLS[wall], i))
                plane[3] += 0.1 * (self.rng.random() < outliers)
                self.seen.append(SeenWall(plane, _ends(plane), (0.1, 2.0), 0.001, 0.003, i, wall))

    def _slipped(self, step: Array) -> Array:
        """A step of the odometry that drags by 2 % and turns by 0.1 degrees."""
        x, y, z = self.rng.normal(0, 0.01, 3)
        return step @ pose(x - 0.02 * np.linalg.norm(step[:3, 3]), y, z, np.radians(0.1))

    def _in_sensor(self, plane_in_building: Array, i: int) -> Array:
        return transform_planes(inverse(self.in_building[i]), plane_in_building)

    def _noisy(self, plane: Array) -> Array:
        normal = plane[:3] + self.rng.normal(0, 0.001, 3)
        return np.array([*(normal / np.linalg.norm(normal)), plane[3] + self.rng.normal(0, 0.003)])

    def optimise(self, anchors: Anchors | None = None, rooms: list[RoomNode] | None = None, steps: int = 20) -> None:
        self.backend.optimise(self.seen, self.levels, rooms or [], anchors, steps)

    def errors(self) -> Array:
        """(N,) metres between estimated and true keyframes; the first one's own errors, which all share, apart."""
        found, true = self.backend.poses[:, :3, 3], self.truth[:, :3, 3]
        T = align_se3(found, true)
        return np.asarray(np.linalg.norm(found @ T[:3, :3].T + T[:3, 3] - true, axis=1))


def angle_between(R: Array, S: Array) -> float:
    return float(np.linalg.norm(Rotation.from_matrix(R.T @ S).as_rotvec()))


def anchors_of(run: Run, T_bim_building: Array, guess_off: Array | None = None) -> tuple[Anchors, Array]:
    """The truth as anchors, with T_map_local guessed `guess_off` away; and T_map_local."""
    T_map_local = inverse(T_bim_building @ run.T_building_map)
    planes = {
        wall: [PlannedWall(transform_planes(T_bim_building, plane), transform_points(T_bim_building, MIDDLES[wall]))]
        for wall, plane in enumerate(WALLS)
    }
    guess = T_map_local if guess_off is None else T_map_local @ guess_off
    return Anchors(guess, planes, {}, {0: (float(T_bim_building[2, 3]), 0.01)}), T_map_local


def built_otherwise(anchors: Anchors, wall: int, offset: float) -> Anchors:
    """The anchors with one wall planned elsewhere by so many metres."""
    planes = dict(anchors.planes)
    planes[wall] = [PlannedWall(p.plane + np.array([0, 0, 0, offset]), p.place) for p in planes[wall]]
    return replace(anchors, planes=planes)
