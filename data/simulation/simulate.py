"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth, in a folder.

All doors are open (their leaves are left out), furniture is included, window panes are opaque, unless effects say
otherwise. The route changes storeys by the building's stairs; the sensor rises along the flight's slope, as if carried
or on legs, and on wheels tilts with it by a small part of its angle.
"""

import shutil
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.imu import write_imu
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.as_built import write_plan_without
from data.simulation.carriers import WHEELED, Carrier
from data.simulation.changes import AS_PLANNED, Change, Changes
from data.simulation.drive import Motion, plan_drive
from data.simulation.effects import checked, furnished, noisy
from data.simulation.furniture import RISE
from data.simulation.route import curve_length
from data.simulation.sensor import VLP_16, Sensor, described, imu_named, measured
from data.simulation.storey_model import load_storeys
from data.simulation.way import Way, way_through
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

Array = NDArray[np.float64]

IMU = "imu.csv"
PLAN = "plan.ifc"  # what the plan shows, where it lacks walls that stand
TOLERANCE = 0.015  # m, standard deviation of a wall's place by the effect `tolerance`
ON_FLOOR = 0.1  # m from a storey's level, at which the robot is on it
SENSOR_TOP = 0.1  # m: half a sensor's height


@dataclass(frozen=True)
class VisitedRoom:
    """A room, the time (s) at which the robot entered it, and the name of its storey."""

    id: str
    name: str
    entered_s: float
    storey: str


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated drive of `length` metres, through `storeys`. `rooms` are in order of entry, starting room first;
    `truth` is T_bim_sensor of each scan. `changes` are the differences from the plan; `stands_off` are the offsets of
    all walls by the effect `tolerance`.
    """

    out_dir: Path
    storeys: tuple[str, ...]
    length: float
    rooms: tuple[VisitedRoom, ...]
    truth: Trajectory
    changes: tuple[Change, ...]
    stands_off: tuple[Change, ...]

    @property
    def plan(self) -> Path | None:
        """The file of the plan without the unplanned walls; None if there are none."""
        path = self.out_dir / PLAN
        return path if path.exists() else None

    @property
    def rooms_entered(self) -> int:
        """The number of different rooms entered."""
        return len({room.id for room in self.rooms})


def simulate(
    building: Path | str,
    storey: str | Sequence[str],
    out_dir: Path | str,
    seed: int = 0,
    min_rooms: int = 8,
    min_length: float = 120.0,
    sensor: Sensor = VLP_16,
    carrier: Carrier = WHEELED,
    effects: Collection[str] = (),
    changes: Changes = AS_PLANNED,
    *,
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seconds: float | None = None,
    imu: str | None = None,
    shaken_from: float | None = None,
    scan_format: str | None = None,
) -> SimulatedRun:
    """Writes a drive to a new folder. Raises UserError for what cannot be, and as the readers of buildings do."""
    effects = checked(effects)
    rolling = carrier.rolling or "rolling" in effects
    scan_format = scan_format or ("ply" if rolling else "bin")
    unit = None if imu is None else imu_named(imu)
    sensor = noisy(sensor) if "returns" in effects else sensor
    _check(Path(out_dir), carrier, scan_format, seed, seconds)
    storeys = [storey] if isinstance(storey, str) else list(storey)
    models = load_storeys(building, storeys, changes, seed, TOLERANCE if "tolerance" in effects else 0.0)
    top, robot = max(carrier.top, carrier.height + SENSOR_TOP), carrier.robot
    way = way_through(models, top, robot, min_rooms, min_length, "steps" in effects, seed)
    motion = carrier.motion(plan_drive(way.legs, way.start_yaw, robot), seed)
    motion = motion if shaken_from is None else motion.shaken(shaken_from)
    R_carrier_sensor = Rotation.from_euler("ZYX", mount_deg[::-1], degrees=True)
    motion = motion.turned(lambda seconds: R_carrier_sensor)
    truth = _truth(sensor, motion, rolling, seconds)
    stamps = truth.stamps_ns / 1e9
    ground = motion.ground(stamps)
    run = SimulatedRun(
        Path(out_dir),
        tuple(model.name for model in models),
        sum(map(curve_length, way.legs)) if seconds is None else curve_length(ground[:, :2]),
        _visited(way, stamps, ground),
        truth,
        models[0].changes,
        tuple(change for model in models for change in model.stands_off),
    )
    world = furnished(effects, way, motion, {room.id for room in run.rooms}, float(stamps[-1]), sensor.beams, seed)
    with _whole_folder(run.out_dir) as folder:
        (folder / "scans").mkdir()
        for k, T_bim_sensor in enumerate(truth.poses):
            rng, chance, stamp = np.random.default_rng([seed, k]), np.random.default_rng([seed, k, 41]), k / sensor.rate
            scene = world.at(stamp + sensor.seconds if rolling else stamp, chance)
            T = motion.poses(stamp + sensor.instants) if rolling else T_bim_sensor
            points, times = sensor.scan(scene, T, rng, k)
            SCAN_WRITERS[scan_format](folder / "scans" / f"{k:06d}.{scan_format}", points, times if rolling else None)
        times_file = "".join(f"{ns_to_seconds(stamp)}\n" for stamp in truth.stamps_ns.tolist())
        write_atomically(folder / "scans" / "times.txt", times_file)
        truth.write_tum(folder / "truth.tum")
        if unit is not None:
            samples = measured(motion.poses, float(stamps[-1]) + 1 / sensor.rate, unit, seed)
            write_imu(samples, folder / "scans" / IMU)
        for name, of in (("changes.json", run.changes), ("tolerances.json", run.stands_off)):
            if of:
                write_json(folder / name, [asdict(change) for change in of])
        if unplanned := [change.id for change in run.changes if change.kind == "unplanned"]:
            write_plan_without(building, unplanned, folder / PLAN)
        write_json(folder / "run.json", {
            "bim": Path(building).name, "storey": models[0].name, "storeys": run.storeys, "seed": seed,
            "scans": len(truth), "length_m": run.length, "rooms_entered": run.rooms_entered,
            "rooms": [asdict(room) for room in run.rooms], "sensor": described(sensor), "robot": asdict(robot),
            "sensor_height_m": carrier.height, "rolling": rolling, "carrier": carrier.name, "imu": imu,
            "times_told": rolling and scan_format in WITH_TIMES, "mount_deg": list(mount_deg),
            "effects": sorted(effects),
        })  # fmt: skip
    return run


def _truth(sensor: Sensor, motion: Motion, rolling: bool, seconds: float | None) -> Trajectory:
    """T_bim_sensor at the scans' stamps, up to the motion's end or, if given, for so many `seconds`."""
    count = int(motion.duration * sensor.rate) + 1
    if seconds is not None:
        count = min(count, max(1, int(np.ceil(seconds * sensor.rate - 1e-9))))
    stamps = np.arange(count) / sensor.rate
    poses = motion.poses(stamps)
    if rolling:  # on stairs, attitudes are those of the way during a scan
        poses = np.concatenate([motion.poses(stamps[k] + sensor.instants[:2])[:1] for k in range(count)])
    return Trajectory(np.rint(stamps * 1e9).astype(np.int64), poses)


def _check(out: Path, carrier: Carrier, scan_format: str, seed: int, seconds: float | None) -> None:
    """Raises UserError for what cannot be."""
    if scan_format not in SCAN_WRITERS:
        raise UserError(f"scan format '{scan_format}' is not known; give one of {', '.join(SCAN_WRITERS)}")
    if not 0 < carrier.height < 10:
        raise UserError(f"a sensor height of {carrier.height} m is impossible; give metres above the floor")
    if seconds is not None and not seconds > 0:
        raise UserError(f"a drive of {seconds:g} s is impossible; give more than 0 seconds")
    if seed < 0:
        raise UserError(f"the seed {seed} is negative; give 0 or more")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"{out}: exists and is not an empty folder; give another one")


def _visited(way: Way, stamps: Array, ground: Array) -> tuple[VisitedRoom, ...]:
    """The rooms entered; the floors of a storey are raised by at most RISE."""
    visited: list[VisitedRoom] = []
    highest = ON_FLOOR + RISE if way.raised.areas else ON_FLOOR
    entered = np.full((len(way.planners), len(ground)), -1)
    for row, planner in enumerate(way.planners):
        above = ground[:, 3] - planner.model.level
        on = (above > -ON_FLOOR) & (above < highest)
        entered[row, on] = planner.grid.room_at(ground[on, :2])
    for stamp, of in zip(stamps, entered.T, strict=True):
        for k, planner in zip(of, way.planners, strict=True):
            room = planner.model.spaces[k]
            if k >= 0 and (not visited or visited[-1].id != room.id):
                visited.append(VisitedRoom(room.id, room.name, float(stamp), planner.model.name))
    return tuple(visited)


@contextmanager
def _whole_folder(path: Path) -> Iterator[Path]:
    """Yields a temporary folder, which is then renamed: all or nothing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror}); give another --out") from None
    try:
        yield unfinished
        unfinished.chmod(0o755)
        unfinished.replace(path)
    except BaseException:
        shutil.rmtree(unfinished)
        raise
