"""A simulated drive of any length, scanned a part at a time: half an hour of scans is gigabytes, a part is not."""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from data.common.errors import UserError
from data.trajectory import Trajectory

if TYPE_CHECKING:
    from data.geometry.raycast import TriangleScene

_PART = 250  # scans
_HEIGHT = 0.8  # m of the sensor above the floor
_SHARE = 0.55  # of a robot's top speed that it has on average, turns on the spot counted


@dataclass(frozen=True)
class DriveSpec:
    """Which drive: so many `scans` through a storey of `bim` (IFC file or mesh), or `standing` where it begins."""

    bim: Path
    storey: str
    scans: int
    standing: bool = False
    seed: int = 0


class EndlessDrive:
    """The drive, as a context. Each scan has a noise of its own, and no place is stood at twice but by chance.

    A process of its own casts the rays, and only while it is waited for, so that neither its memory nor its time is
    that of whoever reads the scans. `truth` is T_bim_sensor of all scans.
    """

    def __init__(self, way: DriveSpec) -> None:
        """Raises UserError for a building or a storey that cannot be driven."""
        self._way, self._folder = way, Path(tempfile.mkdtemp(prefix="drive."))
        context = get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_simulate, args=(theirs, way), daemon=True)
        self._process.start()
        theirs.close()
        self.truth: Trajectory = self._answer()

    def parts(self) -> Iterator[Path]:
        """Folders of scans one after another; each is gone when the next is asked for."""
        for first in range(0, self._way.scans, _PART):
            folder = self._folder / f"{first:08d}"
            self._ours.send((first, min(first + _PART, self._way.scans), folder))
            self._answer()
            yield folder
            shutil.rmtree(folder)

    def _answer(self) -> "Trajectory":
        try:
            answer = self._ours.recv()
        except EOFError:
            raise UserError("the simulator ended early; it has told why above") from None
        if isinstance(answer, UserError):
            self.__exit__(None, None, None)
            raise answer
        return answer  # type: ignore[no-any-return]

    def __enter__(self) -> "EndlessDrive":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ours.close()
        self._process.join(timeout=10)
        shutil.rmtree(self._folder, ignore_errors=True)


def _simulate(asked: Connection, way: DriveSpec) -> None:
    """The process that casts the rays: answers with the truth, then with each part that it is asked for."""
    from data.scans.writers import SCAN_WRITERS
    from data.simulation.simulate import SENSOR
    from data.trajectory.stamps import ns_to_seconds

    try:
        truth, scene = _planned(way)
    except UserError as error:
        asked.send(error)
        return
    asked.send(truth)
    while True:
        try:
            first, last, folder = asked.recv()
        except EOFError:
            return
        folder.mkdir(parents=True)
        for i in range(first, last):
            points = SENSOR.scan(scene, truth.poses[i], np.random.default_rng([way.seed, i]))
            SCAN_WRITERS["bin"](folder / f"{i:08d}.bin", points, None)
        stamps = truth.stamps_ns[first:last].tolist()
        (folder / "times.txt").write_text("".join(f"{ns_to_seconds(stamp)}\n" for stamp in stamps))
        asked.send(None)


def _planned(way: DriveSpec) -> "tuple[Trajectory, TriangleScene]":
    """The way by the simulator's parts, for one storey."""
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
