"""A simulated drive of any length, produced in parts: half an hour of scans takes gigabytes."""

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
_SHARE = 0.55  # mean speed as a share of the top speed, turns on the spot included


@dataclass(frozen=True)
class DriveSpec:
    """A drive of `scans` scans through a storey of `bim` (IFC file or mesh), or `standing` still at its start."""

    bim: Path
    storey: str
    scans: int
    standing: bool = False
    seed: int = 0


class EndlessDrive:
    """A simulated drive, as a context. Each scan has its own noise.

    Another process casts the rays, only while the caller waits for it, so that it adds neither memory nor time to the
    measured process. `truth` is T_bim_sensor of all scans.
    """

    def __init__(self, way: DriveSpec) -> None:
        """Raises UserError for a building or a storey that cannot be driven through."""
        self._way, self._folder = way, Path(tempfile.mkdtemp(prefix="drive."))
        context = get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_simulate, args=(theirs, way), daemon=True)
        self._process.start()
        theirs.close()
        self.truth: Trajectory = self._answer()

    def parts(self) -> Iterator[Path]:
        """Folders of scans, one after another; each is deleted when the next is requested."""
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
            raise UserError("the simulator ended early; see its message above") from None
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


def _simulate(requests: Connection, way: DriveSpec) -> None:
    """The simulator's process: sends the truth, then writes each requested part."""
    from data.scans.writers import SCAN_WRITERS
    from data.simulation.simulate import SENSOR
    from data.trajectory.stamps import ns_to_seconds

    try:
        truth, scene = _planned(way)
    except UserError as error:
        requests.send(error)
        return
    requests.send(truth)
    while True:
        try:
            first, last, folder = requests.recv()
        except EOFError:
            return
        folder.mkdir(parents=True)
        for i in range(first, last):
            points = SENSOR.scan(scene, truth.poses[i], np.random.default_rng([way.seed, i]))
            SCAN_WRITERS["bin"](folder / f"{i:08d}.bin", points, None)
        stamps = truth.stamps_ns[first:last].tolist()
        (folder / "times.txt").write_text("".join(f"{ns_to_seconds(stamp)}\n" for stamp in stamps))
        requests.send(None)


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
