"""A simulated drive of any length, produced in parts: half an hour of scans takes gigabytes."""

import shutil
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from data.common.children import end_with_parent
from data.trajectory import Trajectory

if TYPE_CHECKING:
    from data.geometry.raycast import TriangleScene

PART = 250  # scans
_HEIGHT = 0.8  # m of the sensor above the floor
_SHARE = 0.55  # mean speed as a share of the top speed, turns on the spot included


@dataclass(frozen=True)
class DriveSpec:
    """A drive of `scans` scans through a storey of `bim` (IFC file or mesh), or `standing` still at its start."""

    bim: Path
    storey: str
    scans: int
    standing: bool = False
    seed: int = 0


@contextmanager
def endless_drive(way: DriveSpec) -> Iterator[tuple[Trajectory, Iterator[Path]]]:
    """T_bim_sensor of all scans, and folders of scans, one after another; each is deleted when the next is requested.

    Each scan has its own noise. Another process casts the rays, only while the caller waits for it, so that it adds
    neither memory nor time to the measured process. Raises UserError for a building or a storey that cannot be driven
    through.
    """
    pool = ProcessPoolExecutor(1, get_context("spawn"), end_with_parent)
    with TemporaryDirectory(prefix="drive.") as folder, pool:
        yield pool.submit(_truth, way).result(), _parts(way, Path(folder), pool)


def _parts(way: DriveSpec, folder: Path, pool: ProcessPoolExecutor) -> Iterator[Path]:
    for first in range(0, way.scans, PART):
        part = folder / f"{first:08d}"
        pool.submit(_simulate, way, first, min(first + PART, way.scans), part).result()
        yield part
        shutil.rmtree(part)


def _truth(way: DriveSpec) -> Trajectory:
    return _planned(way)[0]


def _simulate(way: DriveSpec, first: int, last: int, folder: Path) -> None:
    """Writes the scans from `first` to before `last`."""
    from data.scans.writers import SCAN_WRITERS
    from data.simulation.simulate import SENSOR
    from data.trajectory.stamps import ns_to_seconds

    truth, scene = _planned(way)
    folder.mkdir()
    for i in range(first, last):
        points = SENSOR.scan(scene, truth.poses[i], np.random.default_rng([way.seed, i]))
        SCAN_WRITERS["bin"](folder / f"{i:08d}.bin", points, None)
    stamps = truth.stamps_ns[first:last].tolist()
    (folder / "times.txt").write_text("".join(f"{ns_to_seconds(stamp)}\n" for stamp in stamps))


@lru_cache(maxsize=1)
def _planned(way: DriveSpec) -> "tuple[Trajectory, TriangleScene]":
    """The true poses and the scene of a drive through one storey."""
    from data.geometry.raycast import TriangleScene
    from data.plans.mesh_files import is_mesh
    from data.simulation.drive import drive
    from data.simulation.mesh_storey import mesh_storey
    from data.simulation.occupancy import build_grid
    from data.simulation.route import plan_tour
    from data.simulation.simulate import ROBOT, ROBOT_TOP, SENSOR
    from data.simulation.storey_model import load_storey
    from sgslam.geometry.frames import se2_to_se3

    model = mesh_storey(way.bim, way.storey) if is_mesh(way.bim) else load_storey(way.bim, way.storey)
    scene = TriangleScene(model.solid)
    grid = build_grid(model, scene, ROBOT_TOP)
    stamps, poses, share = np.empty(0), np.empty((0, 3)), _SHARE
    while len(poses) < (1 if way.standing else way.scans):
        length = 1.0 if way.standing else way.scans / SENSOR.rate * ROBOT.speed * share
        legs = plan_tour(grid, ROBOT.radius, 1, length, np.random.default_rng(way.seed))
        stamps, poses = drive(legs, 0.0, ROBOT, SENSOR.rate)
        share *= 1.3
    if way.standing:
        stamps, poses = np.arange(way.scans) / SENSOR.rate, np.repeat(poses[:1], way.scans, axis=0)
    T_bim_sensor = [se2_to_se3(yaw, x, y, model.level + _HEIGHT) for x, y, yaw in poses[: way.scans].tolist()]
    return Trajectory(np.rint(stamps[: way.scans] * 1e9).astype(np.int64), np.stack(T_bim_sensor)), scene
