"""Simulated drives for measuring loop closure: scans on demand, the truth, and an external odometry."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation import Robot, SpinningSensor
from data.simulation.drive import drive
from data.simulation.simulate import ROBOT_TOP
from data.trajectory import Trajectory
from evaluation.drives.loop_buildings import LoopBuilding, long_corridor, ring
from evaluation.drives.weakened import shortened, worsened
from sgslam.geometry.frames import se2_to_se3

Floats = NDArray[np.float64]
Route = Literal["along", "visits", "back", "visits-back", "ring"]
"""Once along the corridor, never back; the same, into some offices; along the corridor and back; the same, into other
offices each way; once around the ring of corridors, and on past the start."""
ONCE = ("along", "visits")  # routes that never come back: any closure is false
SENSOR_HEIGHT, STEP = 0.8, 0.01  # m
PAST_THE_START = 12.0  # m


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive: `truth` is T_bim_sensor. With a `level` above 0 the range is a few metres and `odometry` (N, 4, 4) is a
    degraded T_odom_sensor."""

    scene: TriangleScene
    truth: Trajectory
    seed: int
    level: int
    odometry: Floats | None

    def scans(self) -> Iterator[tuple[int, Floats, Floats | None]]:
        """Stamp (ns), points (N, 3) in the sensor frame, and T_odom_sensor (4, 4) or None, of each scan."""
        sensor = SpinningSensor()
        for k, (stamp_ns, pose) in enumerate(zip(self.truth.stamps_ns.tolist(), self.truth.poses, strict=True)):
            points = sensor.scan(self.scene, pose, np.random.default_rng([self.seed, k])).astype(float)
            given = None if self.odometry is None else self.odometry[k]
            yield stamp_ns, shortened(points) if self.level else points, given


def drive_along(route: Route, seed: int, level: int = 0) -> Drive:
    """Drives a route; the same seed gives the same scans.

    A `level` above 0 degrades the front end, see `evaluation.drives.weakened`.
    """
    rng = np.random.default_rng([seed, 11])
    building = ring() if route == "ring" else long_corridor()
    legs = [_leg(a, b) for a, b in pairwise(_places(route, building, rng))]
    return _driven(legs, TriangleScene(building.triangles), SENSOR_HEIGHT, rng, seed, level)


def drive_through(bim: Path, storey: str, length: float, seed: int, level: int = 0) -> Drive:
    """A round trip of at least `length` metres through the rooms of an IFC model's storey.

    Raises UserError as the simulator does.
    """
    from data.simulation.occupancy import build_grid
    from data.simulation.route import plan_tour
    from data.simulation.storey_model import load_storey

    model = load_storey(bim, storey)
    scene, rng = TriangleScene(model.solid), np.random.default_rng([seed, 12])
    legs = plan_tour(build_grid(model, scene, ROBOT_TOP), Robot().radius, 8, length, rng)
    return _driven(list(legs), scene, model.level + SENSOR_HEIGHT, rng, seed, level)


def _driven(
    legs: list[Floats], scene: TriangleScene, height: float, rng: np.random.Generator, seed: int, level: int
) -> Drive:
    stamps, poses = drive(legs, float(rng.uniform(-np.pi, np.pi)), Robot(), SpinningSensor().rate)
    T = [se2_to_se3(yaw, x, y, height) for x, y, yaw in poses.tolist()]
    truth = Trajectory(np.rint(stamps * 1e9).astype(np.int64), np.stack(T))
    return Drive(scene, truth, seed, level, worsened(truth.poses, level, seed) if level else None)


def _places(route: Route, building: LoopBuilding, rng: np.random.Generator) -> Floats:
    """(N, 2) the turning points of the path; the legs between them are straight."""
    if route == "ring":
        way = building.way + rng.uniform(-0.2, 0.2, building.way.shape)
        ahead = (way[1] - way[0]) / np.linalg.norm(way[1] - way[0])
        return np.concatenate([way[:-1], (way[0] + PAST_THE_START * ahead)[None]])
    there = _row(building, rng, 4 if "visits" in route else 0)
    if not route.endswith("back"):
        return there
    return np.concatenate([there, _row(building, rng, 4 if "visits" in route else 0)[::-1]])


def _row(building: LoopBuilding, rng: np.random.Generator, visits: int) -> Floats:
    """(N, 2) turning points along the corridor, with `visits` offices entered on the way."""
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
