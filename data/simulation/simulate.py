"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth.

All doors are open (their leaves are left out), furniture is included, window panes are opaque. The route changes
storeys by the building's stairs; the sensor rises along the flight's slope, as if carried or on legs, and tilts with it
by a small part of its angle.
"""

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.plans.mesh_files import is_mesh
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.changes import Change, Changes, write_plan_without
from data.simulation.drive import Robot, drive
from data.simulation.sensor import SpinningSensor
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

if TYPE_CHECKING:
    from data.geometry.raycast import TriangleScene
    from data.simulation.occupancy import Grid
    from data.simulation.storey_model import StoreyModel

    Grids = dict[StoreyModel, Grid]

Settings = dict[str, object]  # for run.json

SENSOR = SpinningSensor()
ROBOT = Robot()
ROBOT_TOP = 1.6  # m above the floor: the robot passes under what is higher, unless its sensor is higher still
PLAN = "plan.ifc"  # what the plan shows, where it lacks walls that stand
ON_FLOOR = 0.1  # m from a storey's level, at which the robot is on it
LEAN = 0.15  # share of a stair's slope by which the sensor tilts: it is carried nearly level
SENSOR_TOP = 0.1  # m: half a sensor's height


@dataclass(frozen=True)
class VisitedRoom:
    """A room (GlobalId, Name and LongName of its IfcSpace), when the robot entered it, in seconds, and the name of its
    storey."""

    id: str
    name: str
    long_name: str
    entered_s: float
    storey: str = ""


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated drive. `rooms` are in order of entry, starting room first; `truth` is T_bim_sensor of each scan.

    `storey` is where it began, `storeys` are all in order. Metres, seconds, radians; `start_yaw` is in the BIM frame.
    `changes` are the differences from the plan.
    """

    out_dir: Path
    storey: str
    seed: int
    length: float
    start_yaw: float
    rooms: tuple[VisitedRoom, ...]
    truth: Trajectory
    changes: tuple[Change, ...] = ()
    storeys: tuple[str, ...] = ()

    @property
    def rooms_entered(self) -> int:
        """The number of different rooms entered."""
        return len({room.id for room in self.rooms})


def simulate(
    ifc: Path | str,
    storey: str | Sequence[str],
    out_dir: Path | str,
    seed: int = 0,
    min_rooms: int = 8,
    min_length: float = 120.0,
    sensor: SpinningSensor = SENSOR,
    robot: Robot = ROBOT,
    sensor_height: float = 0.8,
    scan_format: str = "bin",
    changes: Changes | None = None,
    and_back: bool = False,
    rolling: bool = False,
) -> SimulatedRun:
    """Drives through a storey's open doors, from a random place and heading, and writes scans and truth.

    `ifc` may also be a building's mesh (see `data.plans.mesh_plan`); `storey` is then the name of one of its levels, or
    empty for the lowest. Several storeys are driven in the given order; a storey named again is visited again.

    The robot enters `min_rooms` rooms (all, if fewer can be reached), drives at least `min_length` metres, and returns
    (on each of several storeys, before it takes the stairs). The sensor is level, `sensor_height` metres above the
    storey's floor. `changes` are made to the building, not to its plan, and need a drive on one storey. With `and_back`
    the whole route is then driven in reverse, so that every place is seen twice. With `rolling` the sensor moves while
    it turns: a scan's stamp and true pose are those of its first azimuth. The same seed gives the same bytes.

    Raises UserError for an unreadable IFC file, an unknown storey, one on which the robot cannot move, storeys without
    stairs that it can climb, an `out_dir` that is not empty, and impossible settings.
    """
    from data.geometry.raycast import TriangleScene
    from data.simulation.occupancy import build_grid
    from data.simulation.route import curve_length

    out = Path(out_dir)
    _check(out, scan_format, sensor_height, seed, rolling)
    models = _models(ifc, [storey] if isinstance(storey, str) else list(storey), changes, seed)
    scene = TriangleScene(np.concatenate([m.solid for m in dict.fromkeys(models)]))
    height = max(ROBOT_TOP, sensor_height + SENSOR_TOP)
    grids = {model: build_grid(model, scene, height) for model in dict.fromkeys(models)}
    rng = np.random.default_rng(seed)
    start_yaw = float(rng.uniform(-np.pi, np.pi))
    legs = _legs(models, grids, scene, robot.radius, min_rooms, min_length, rng)
    if and_back:
        legs = (*legs, *(leg[::-1] for leg in reversed(legs)))
    steps = sensor.azimuths if rolling else 1  # poses a scan
    stamps, poses = drive(legs, start_yaw, robot, sensor.rate * steps)
    way = _Way(poses, models[0].level, sensor_height, steps)
    stamps, poses = stamps[::steps], poses[::steps]
    T_bim_sensor = _sensor_poses(poses, way.level, sensor_height)
    if rolling:
        T_bim_sensor = np.stack([way.during(i)[0] for i in range(len(stamps))])
    truth = Trajectory(np.rint(stamps * 1e9).astype(np.int64), T_bim_sensor)
    run = SimulatedRun(
        out, models[0].name, seed, sum(map(curve_length, legs)), start_yaw, _visited(grids, stamps, poses), truth,
        models[0].changes, tuple(model.name for model in models),
    )  # fmt: skip
    settings: Settings = {"bim": Path(ifc).name, "sensor": asdict(sensor), "robot": asdict(robot)}
    settings |= {"sensor_height_m": sensor_height, "rolling": rolling}
    _write(run, scene, sensor, scan_format, settings, ifc, way)
    return run


@dataclass(frozen=True, eq=False)
class _Way:
    """All that was driven, as `drive` gives it, `steps` poses a scan; the storey's level, and the sensor's height."""

    poses: NDArray[np.float64]
    level: float
    height: float
    steps: int

    def during(self, scan: int) -> NDArray[np.float64]:
        """(steps, 4, 4) T_bim_sensor at each azimuth of a scan; the last pose stays."""
        chosen = np.minimum(np.arange(scan * self.steps, (scan + 1) * self.steps), len(self.poses) - 1)
        return _sensor_poses(self.poses[chosen], self.level, self.height)


def _check(out: Path, scan_format: str, sensor_height: float, seed: int, rolling: bool) -> None:
    if scan_format not in SCAN_WRITERS:
        raise UserError(f"scan format '{scan_format}' is not known; take one of {', '.join(SCAN_WRITERS)}")
    if rolling and scan_format not in WITH_TIMES:
        raise UserError(f"rolling scans need a format with points' times: {' or '.join(WITH_TIMES)}, not {scan_format}")
    if not 0 < sensor_height < 10:
        raise UserError(f"a sensor height of {sensor_height} m cannot be; give metres above the floor")
    if seed < 0:
        raise UserError(f"the seed {seed} is negative; give 0 or more")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"{out}: exists already and is not an empty folder; give another one")


def _models(ifc: Path | str, storeys: list[str], changes: Changes | None, seed: int) -> "list[StoreyModel]":
    from data.simulation.mesh_storey import mesh_storey
    from data.simulation.storey_model import load_storey, load_storeys

    if len(storeys) == 1:
        only = storeys[0]
        return [mesh_storey(ifc, only, changes) if is_mesh(ifc) else load_storey(ifc, only, changes, seed)]
    if changes is not None and changes.any:
        raise UserError("walls that stand otherwise than planned: give one storey, not several")
    if is_mesh(ifc):
        raise UserError(f"{ifc}: a mesh has no marked stairs; give one storey, or an IFC file")
    return load_storeys(ifc, storeys)


def _legs(
    models: "list[StoreyModel]", grids: "Grids", scene: "TriangleScene", radius: float, min_rooms: int,
    min_length: float, rng: np.random.Generator,
) -> tuple[NDArray[np.float64], ...]:  # fmt: skip
    """(N, 2) on one storey, (N, 3) over several."""
    from data.simulation.multi_storey_drive import plan_storeys
    from data.simulation.route import Planner, plan_tour
    from data.simulation.stairs import Storey

    if len(models) == 1:
        return plan_tour(grids[models[0]], radius, min_rooms, min_length, rng)
    of = {model: Storey(model, Planner(grid, radius, rng)) for model, grid in grids.items()}
    return plan_storeys([of[model] for model in models], scene, radius, min_rooms, min_length, rng)


def _sensor_poses(poses: NDArray[np.float64], level: float, height: float) -> NDArray[np.float64]:
    """(N, 4, 4) T_bim_sensor at x y yaw (N, 3), or x y yaw z (N, 4), `height` above the ground, which is at z or at
    `level`; level, but for stairs."""
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, :2, 3], T[:, 2, 3] = poses[:, :2], level + height
    if poses.shape[1] == 4:
        T[:, 2, 3] = poses[:, 3] + height
        moved = np.gradient(poses, axis=0)
        forward = np.linalg.norm(moved[:, :2], axis=1)
        up = LEAN * np.arctan2(np.where(forward > 1e-6, moved[:, 3], 0.0), np.maximum(forward, 1e-6))
        nose_up = np.tile(np.eye(4), (len(poses), 1, 1))
        nose_up[:, 0, 0], nose_up[:, 0, 2] = np.cos(up), -np.sin(up)
        nose_up[:, 2, 0], nose_up[:, 2, 2] = np.sin(up), np.cos(up)
        T = T @ nose_up
    return T


def _visited(grids: "Grids", stamps: NDArray[np.float64], poses: NDArray[np.float64]) -> tuple[VisitedRoom, ...]:
    visited: list[VisitedRoom] = []
    z = poses[:, 3] if poses.shape[1] == 4 else np.full(len(poses), next(iter(grids)).level)
    entered = np.full((len(grids), len(poses)), -1)
    for row, (model, grid) in enumerate(grids.items()):
        on = np.abs(z - model.level) < ON_FLOOR
        entered[row, on] = grid.room_at(poses[on, :2])
    for stamp, of in zip(stamps, entered.T, strict=True):
        for k, (model, grid) in zip(of, grids.items(), strict=True):
            if k >= 0 and (not visited or visited[-1].id != grid.rooms[k].id):
                room = grid.rooms[k]
                visited.append(VisitedRoom(room.id, room.name, room.long_name, float(stamp), model.name))
    return tuple(visited)


def _write(
    run: SimulatedRun, scene: "TriangleScene", sensor: SpinningSensor, scan_format: str, settings: Settings,
    bim: Path | str, way: _Way,
) -> None:  # fmt: skip
    """Casts the rays and writes to a temporary folder, which is then renamed: all or nothing."""
    run.out_dir.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(dir=run.out_dir.parent, prefix=f".{run.out_dir.name}."))
    try:
        (scans := unfinished / "scans").mkdir()
        for i, T_bim_sensor in enumerate(run.truth.poses):
            rng, times = np.random.default_rng([run.seed, i]), None
            if way.steps == 1:
                points = sensor.scan(scene, T_bim_sensor, rng)
            else:
                points, times = sensor.sweep(scene, way.during(i), rng)
            SCAN_WRITERS[scan_format](scans / f"{i:06d}.{scan_format}", points, times)
        stamps = run.truth.stamps_ns.tolist()
        write_atomically(scans / "times.txt", "".join(f"{ns_to_seconds(stamp)}\n" for stamp in stamps))
        run.truth.write_tum(unfinished / "truth.tum")
        if run.changes:
            write_json(unfinished / "changes.json", [asdict(change) for change in run.changes])
        if unplanned := [change.id for change in run.changes if change.kind == "unplanned"]:
            write_plan_without(bim, unplanned, unfinished / PLAN)
        write_json(unfinished / "run.json", {
            "storey": run.storey, "storeys": run.storeys, "seed": run.seed, "scans": len(run.truth),
            "length_m": run.length, "start_yaw_rad": run.start_yaw, "rooms_entered": run.rooms_entered,
            "rooms": [asdict(room) for room in run.rooms], **settings,
        })  # fmt: skip
        unfinished.chmod(0o755)
        unfinished.replace(run.out_dir)
    except BaseException:
        shutil.rmtree(unfinished)
        raise
