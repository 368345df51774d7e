"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth, in a folder.

All doors are open (their leaves are left out), furniture is included, window panes are opaque, unless effects say
otherwise. The route changes storeys by the building's stairs; the sensor rises along the flight's slope, as if carried
or on legs, and on wheels tilts with it by a small part of its angle.
"""

import shutil
import tempfile
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.imu import ImuSamples, write_imu
from data.scans.point_times import BEFORE_STAMP, Stamped
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.carriers import WHEELED, Carrier, Motion
from data.simulation.changes import AS_PLANNED, Change, Changes
from data.simulation.changes.as_built import write_plan_without
from data.simulation.drive import plan_drive
from data.simulation.effects import Timing, checked, timing_of
from data.simulation.effects.platforms import RISE
from data.simulation.effects.world import IN_SCENE, Driven, World, furnished, noisy
from data.simulation.route import curve_length
from data.simulation.sensor import (
    VLP_16,
    ImuModel,
    Sensor,
    described,
    imu_named,
    instants,
    measured,
    moving_scan,
    snapshot,
)
from data.simulation.storey_model import load_storeys
from data.simulation.way import Grids, way_through
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

Settings = dict[str, object]  # for run.json
Array = NDArray[np.float64]

IMU = "imu.csv"
PLAN = "plan.ifc"  # what the plan shows, where it lacks walls that stand
TOLERANCE = 0.015  # m, standard deviation of a wall's place by the effect `tolerance`
ON_FLOOR = 0.1  # m from a storey's level, at which the robot is on it
SENSOR_TOP = 0.1  # m: half a sensor's height


@dataclass(frozen=True)
class VisitedRoom:
    """A room (GlobalId, Name and LongName of its IfcSpace), the time (s) at which the robot first entered it, and the
    name of its storey."""

    id: str
    name: str
    long_name: str
    entered_s: float
    storey: str = ""


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated drive. `rooms` are in order of entry, starting room first; `truth` is T_bim_sensor of each scan.

    `storey` is where it began, `storeys` are all of them in order. Lengths are in metres, angles in radians;
    `start_yaw` is in the BIM frame. `changes` are the differences from the plan; `stands_off` are the offsets of all
    walls by the effect `tolerance`.
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
    stands_off: tuple[Change, ...] = ()

    @property
    def plan(self) -> Path | None:
        """The file of the plan without the unplanned walls; None if there are none."""
        path = self.out_dir / PLAN
        return path if path.exists() else None

    @property
    def rooms_entered(self) -> int:
        """The number of different rooms entered."""
        return len({room.id for room in self.rooms})


@dataclass(frozen=True, eq=False)
class Taken:
    """A sensor taken along a motion, turned in the carrier's hand by roll, pitch and yaw `mount_deg`, and an `imu` in
    it if there is one. Stamps are those of the instant of a scan that `stamped` names."""

    sensor: Sensor
    motion: Motion
    mount_deg: tuple[float, float, float]
    timing: Timing
    imu: ImuModel | None = None
    stamped: Stamped = "start"

    @cached_property
    def _mount(self) -> Array:
        if not any(self.mount_deg):
            return np.eye(4)
        from scipy.spatial.transform import Rotation  # here, because it takes a third of a second

        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("ZYX", self.mount_deg[::-1], degrees=True).as_matrix()
        return T

    def truth(self, seconds: float | None) -> Trajectory:
        """T_bim_sensor at the scans' stamps, up to the motion's end or, if given, for so many `seconds`."""
        rate = self.sensor.rate
        count = int(self.motion.duration * rate) + 1
        if seconds is not None:
            count = min(count, max(1, int(np.ceil(seconds * rate - 1e-9))))
        stamps = np.arange(count) / rate + BEFORE_STAMP[self.stamped] / rate
        if self.timing == "snapshots" or self.stamped != "start":
            T_bim_sensor = self.motion.poses(stamps) @ self._mount
        else:
            T_bim_sensor = np.concatenate([self._poses(k, 2)[:1] for k in range(count)])
        return Trajectory(np.rint(stamps * 1e9).astype(np.int64), T_bim_sensor)

    def inertial(self, truth: Trajectory, seed: int) -> ImuSamples | None:
        """What the IMU measures until the last scan's end, in the sensor's axes; None without one."""
        if self.imu is None:
            return None
        end = float(truth.stamps_ns[-1] / 1e9) + 1 / self.sensor.rate
        return measured(lambda seconds: self.motion.poses(seconds) @ self._mount, end, self.imu, seed)

    def scan(
        self, k: int, T_bim_sensor: Array, world: World, seed: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Points (N, 3) of scan k and, where they are given, their times (N,) in seconds after the stamp."""
        rng, chance = np.random.default_rng([seed, k]), np.random.default_rng([seed, k, 41])
        stamp = k / self.sensor.rate
        if self.timing == "snapshots":
            return snapshot(self.sensor, world.at(stamp, chance), T_bim_sensor, rng, k), None
        scene = world.at(stamp + self.sensor.rays(k)[1], chance)
        points, times = moving_scan(self.sensor, scene, self._poses(k), rng, k)
        after = times - np.float32(BEFORE_STAMP[self.stamped] / self.sensor.rate)
        return points, after if self.timing == "rolling" else None

    def _poses(self, k: int, first: int | None = None) -> Array:
        """(M, 4, 4) T_bim_sensor at the first instants, or all, at which scan k measures."""
        after = instants(self.sensor.rays(k)[1])[:first]
        return np.asarray(self.motion.poses(k / self.sensor.rate + after) @ self._mount)


def write_run(
    run: SimulatedRun, taken: Taken, world: World, scan_format: str, settings: Settings, bim: Path | str
) -> None:
    """Casts the rays and writes to a temporary folder, which is then renamed: all or nothing."""
    try:
        run.out_dir.parent.mkdir(parents=True, exist_ok=True)
        unfinished = Path(tempfile.mkdtemp(dir=run.out_dir.parent, prefix=f".{run.out_dir.name}."))
    except OSError as error:
        raise UserError(f"{run.out_dir}: cannot be written ({error.strerror}); give another --out") from None
    try:
        (scans := unfinished / "scans").mkdir()
        for i, T_bim_sensor in enumerate(run.truth.poses):
            points, times = taken.scan(i, T_bim_sensor, world, run.seed)
            SCAN_WRITERS[scan_format](scans / f"{i:06d}.{scan_format}", points, times)
        stamps = run.truth.stamps_ns.tolist()
        write_atomically(scans / "times.txt", "".join(f"{ns_to_seconds(stamp)}\n" for stamp in stamps))
        run.truth.write_tum(unfinished / "truth.tum")
        if (inertial := taken.inertial(run.truth, run.seed)) is not None:
            write_imu(inertial, scans / IMU)
        for name, changes in (("changes.json", run.changes), ("tolerances.json", run.stands_off)):
            if changes:
                write_json(unfinished / name, [asdict(change) for change in changes])
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
    and_back: bool = False,
    seconds: float | None = None,
    imu: str | None = None,
    stamped: Stamped = "start",
    scan_format: str | None = None,
) -> SimulatedRun:
    effects = checked(effects)
    timing = timing_of(effects, carrier.rolling)
    scan_format = scan_format or ("ply" if timing == "rolling" else "bin")
    unit = None if imu is None else imu_named(imu)
    sensor = noisy(sensor) if "returns" in effects else sensor
    _check(Path(out_dir), carrier, timing, scan_format, seed, seconds, stamped)
    storeys = [storey] if isinstance(storey, str) else list(storey)
    models = load_storeys(building, storeys, changes, seed, TOLERANCE if "tolerance" in effects else 0.0)
    top, robot = max(carrier.top, carrier.height + SENSOR_TOP), carrier.robot
    way = way_through(models, top, robot, min_rooms, min_length, and_back, "steps" in effects, seed)
    motion = carrier.motion(plan_drive(way.legs, way.start_yaw, robot), models[0].level, seed)
    taken = Taken(sensor, motion, mount_deg, timing, unit, stamped)
    truth = taken.truth(seconds)
    stamps = truth.stamps_ns / 1e9
    ground = motion.ground(stamps)
    rooms = _visited(way.grids, stamps, ground, ON_FLOOR if way.raised is None else ON_FLOOR + RISE)
    run = SimulatedRun(
        out_dir=Path(out_dir),
        storey=models[0].name,
        seed=seed,
        length=sum(map(curve_length, way.legs)) if seconds is None else curve_length(ground[:, :2]),
        start_yaw=way.start_yaw,
        rooms=rooms,
        truth=truth,
        changes=models[0].changes,
        storeys=tuple(model.name for model in models),
        stands_off=tuple(change for model in models for change in model.stands_off),
    )
    world = World(way.scene)
    if effects & IN_SCENE:
        drive = Driven(way.grids, way.legs, motion, [room.id for room in rooms], float(stamps[-1]), robot.radius)
        world = furnished(effects, drive, way.raised, sensor.beams, seed)
    settings = {
        "bim": Path(building).name,
        "sensor": described(sensor),
        "robot": asdict(robot),
        "sensor_height_m": carrier.height,
        "rolling": timing != "snapshots",
        "times_told": timing == "rolling",
        "carrier": carrier.name,
        "mount_deg": list(mount_deg),
        "effects": sorted(effects),
        **({} if imu is None else {"imu": imu}),
    }
    write_run(run, taken, world, scan_format, settings, building)
    return run


def _check(
    out: Path,
    carrier: Carrier,
    timing: Timing,
    scan_format: str,
    seed: int,
    seconds: float | None,
    stamped: Stamped,
) -> None:
    """Raises UserError for what cannot be."""
    if scan_format not in SCAN_WRITERS:
        raise UserError(f"scan format '{scan_format}' is not known; give one of {', '.join(SCAN_WRITERS)}")
    if timing == "rolling" and scan_format not in WITH_TIMES:
        raise UserError(
            f"the sensor moves during a scan, and {scan_format} files hold no times of points; write "
            f"{' or '.join(WITH_TIMES)}, or leave them out by the effect 'untimed'"
        )
    if timing == "snapshots" and stamped != "start":
        raise UserError(f"a scan of one instant has no {stamped} to stamp; add the effect 'rolling' or 'untimed'")
    if not 0 < carrier.height < 10:
        raise UserError(f"a sensor height of {carrier.height} m is impossible; give metres above the floor")
    if seconds is not None and not seconds > 0:
        raise UserError(f"a drive of {seconds:g} s is impossible; give more than 0 seconds")
    if seed < 0:
        raise UserError(f"the seed {seed} is negative; give 0 or more")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"{out}: exists and is not an empty folder; give another one")


def _visited(
    grids: Grids, stamps: NDArray[np.float64], poses: NDArray[np.float64], highest: float
) -> tuple[VisitedRoom, ...]:
    """The rooms entered; on a storey's floor is what lies up to `highest` (m) above its level."""
    visited: list[VisitedRoom] = []
    z = poses[:, 3] if poses.shape[1] == 4 else np.full(len(poses), next(iter(grids)).level)
    entered = np.full((len(grids), len(poses)), -1)
    for row, (model, grid) in enumerate(grids.items()):
        on = (np.abs(z - model.level) < ON_FLOOR) | ((z > model.level) & (z - model.level < highest))
        entered[row, on] = grid.room_at(poses[on, :2])
    for stamp, of in zip(stamps, entered.T, strict=True):
        for k, (model, grid) in zip(of, grids.items(), strict=True):
            if k >= 0 and (not visited or visited[-1].id != grid.rooms[k].id):
                room = grid.rooms[k]
                visited.append(VisitedRoom(room.id, room.name, room.long_name, float(stamp), model.name))
    return tuple(visited)
