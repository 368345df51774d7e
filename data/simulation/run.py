"""A simulated run: what is measured along a motion, and the folder that it is written to."""

import shutil
import tempfile
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.imu import ImuSamples, write_imu
from data.scans.point_times import BEFORE_STAMP, Stamped
from data.scans.writers import SCAN_WRITERS
from data.simulation.carriers import Motion
from data.simulation.changes import Change
from data.simulation.changes.as_built import write_plan_without
from data.simulation.effects import Timing
from data.simulation.effects.world import World
from data.simulation.imu import ImuModel, measured
from data.simulation.sensor import Sensor, instants, moving_scan, snapshot
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

Settings = dict[str, object]  # for run.json
Array = NDArray[np.float64]

IMU = "imu.csv"
PLAN = "plan.ifc"  # what the plan shows, where it lacks walls that stand


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
