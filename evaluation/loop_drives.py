"""Drives for the measurement of loop closure: scans made as they are asked for, the truth, and the odometry given."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data.drive import Robot, drive
from data.errors import UserError
from data.raycast import TriangleScene
from data.sensor import SpinningSensor
from data.trajectory import Trajectory
from evaluation.loop_buildings import Drawn, long_corridor, ring
from evaluation.weakened import shortened, worsened

Floats = NDArray[np.float64]
ROUTES = {
    "along": "once along the corridor, never back",
    "visits": "once along the corridor, into some offices",
    "back": "along the corridor and back",
    "visits-back": "along the corridor and back, into other offices each way",
    "ring": "once around the ring of corridors, and on past the start",
}
SENSOR_HEIGHT, STEP = 0.8, 0.01  # m
PAST_THE_START = 12.0  # m


@dataclass(frozen=True, eq=False)
class Drive:
    """`truth` are sensor poses in the building's frame; `odometry` (N, 4, 4) T_odom_sensor where it is given."""

    scene: TriangleScene
    truth: Trajectory
    seed: int
    level: int
    odometry: Floats | None

    def scans(self) -> Iterator[tuple[int, Floats]]:
        """Stamp and points (N, 3) of each scan, sensor frame; a weak sensor's end at a few metres."""
        sensor = SpinningSensor()
        for k, (stamp_ns, pose) in enumerate(zip(self.truth.stamps_ns.tolist(), self.truth.poses, strict=True)):
            points = sensor.scan(self.scene, pose, np.random.default_rng([self.seed, k])).astype(float)
            yield stamp_ns, shortened(points) if self.level else points


def drive_along(route: str, seed: int, level: int = 0) -> Drive:
    """Drives one of `ROUTES`; the same seed gives the same scans.

    With a `level` above 0 the front end is weak: see `evaluation.weakened`. Raises UserError for an unknown route.
    """
    if route not in ROUTES:
        raise UserError(f"no route '{route}'; there are {', '.join(ROUTES)}")
    rng = np.random.default_rng([seed, 11])
    building = ring() if route == "ring" else long_corridor()
    places = _places(route, building, rng)
    legs = [_leg(a, b) for a, b in pairwise(places)]
    stamps, poses = drive(legs, float(rng.uniform(-np.pi, np.pi)), Robot(), SpinningSensor().rate)
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, :2, 3], T[:, 2, 3] = poses[:, :2], SENSOR_HEIGHT
    truth = Trajectory(np.rint(stamps * 1e9).astype(np.int64), T)
    odometry = worsened(truth.poses, level, seed) if level else None
    return Drive(TriangleScene(building.triangles), truth, seed, level, odometry)


def _places(route: str, building: Drawn, rng: np.random.Generator) -> Floats:
    """(N, 2) where the robot turns: each leg between two is straight."""
    if route == "ring":
        way = building.way + rng.uniform(-0.2, 0.2, building.way.shape)
        ahead = (way[1] - way[0]) / np.linalg.norm(way[1] - way[0])
        return np.concatenate([way[:-1], (way[0] + PAST_THE_START * ahead)[None]])
    there = _row(building, rng, 4 if "visits" in route else 0)
    if not route.endswith("back"):
        return there
    return np.concatenate([there, _row(building, rng, 4 if "visits" in route else 0)[::-1]])


def _row(building: Drawn, rng: np.random.Generator, visits: int) -> Floats:
    """Along the corridor, with so many offices entered on the way."""
    chosen = rng.choice(len(building.doors), visits, replace=False)
    chosen = chosen[np.argsort(building.doors[chosen, 0], kind="stable")]
    places = [building.way[0] + rng.uniform(-0.2, 0.2, 2)]
    for k in chosen:
        before = np.array([building.doors[k, 0], rng.uniform(-0.2, 0.2)])
        inside = building.inside[k] + np.array([0.0, rng.uniform(-0.4, 0.4)])
        places += [before, inside, before + 0.001]
    return np.array([*places, building.way[1] + rng.uniform(-0.2, 0.2, 2)])


def _leg(a: Floats, b: Floats) -> Floats:
    count = max(2, round(float(np.linalg.norm(b - a)) / STEP) + 1)
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
