"""A drive through a small building, whose plan and whose robot's true way are known; simulated once for all tests."""

import functools
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from boxes import Array
from small_ifc import write_small_ifc

from data.plans import Bim, load_bim
from data.scans import ScanFolder
from data.simulation import Robot, Sensor
from data.simulation.carriers import WHEELED
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from sgslam.result import Result
from sgslam.slam import SceneGraphSlam

CARRIER = replace(WHEELED, robot=Robot(speed=1.0, yaw_rate=1.2, yaw_acceleration=2.0))
SENSOR = Sensor(azimuths=450, rate=5.0)


@dataclass(frozen=True)
class Drive:
    """`truth` is T_bim_sensor of each scan; `names` are those of the rooms by GlobalId. `folder` has the model."""

    bim: Bim
    scans: list[tuple[int, Array]]
    truth: Trajectory
    names: dict[str, str]
    folder: tempfile.TemporaryDirectory[str]

    def errors(self, result: Result) -> Array:
        """(N,) metres of each pose in the BIM frame, no alignment."""
        return np.asarray(np.linalg.norm(off(result.trajectory, self.truth), axis=1))

    def rmse(self, result: Result) -> float:
        """Metres in the BIM frame, no alignment."""
        return float(np.sqrt(np.mean(self.errors(result) ** 2)))


def off(found: Trajectory, truth: Trajectory) -> Array:
    """(N, 3) metres from the true positions at the same stamps."""
    return np.asarray(found.positions - truth.at(found.stamps_ns)[:, :3, 3])


@functools.cache
def small_drive() -> Drive:
    """Through all three rooms of `small_ifc`'s building, which lies far from zero and is turned."""
    kept = tempfile.TemporaryDirectory()
    folder = Path(kept.name)
    building = write_small_ifc(folder / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
    run = simulate(
        building.path, "Ground", folder / "run", seed=3, min_rooms=3, min_length=20.0, sensor=SENSOR, carrier=CARRIER
    )
    scans = [(scan.stamp_ns, scan.points) for scan in ScanFolder(run.out_dir / "scans")]
    return Drive(load_bim(building.path, folder / "cache"), scans, run.truth, building.rooms, kept)


@functools.cache
def small_run(with_bim: bool) -> tuple[SceneGraphSlam, Result]:
    """The whole drive, and what came of it, with the plan or without; for all who change nothing of it."""
    drive = small_drive()
    slam = fed(SceneGraphSlam(drive.bim if with_bim else None), drive.scans)
    return slam, slam.finish()


def fed(slam: SceneGraphSlam, scans: Iterable[tuple[int, Array]]) -> SceneGraphSlam:
    """The same, after all scans, each measured at one instant: where that is not told, each is registered twice."""
    for stamp_ns, points in scans:
        slam.add_scan(stamp_ns, points, np.zeros(len(points)))
    return slam
