"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth.

All doors are open (their leaves are left out), furniture is included, window panes are opaque, unless effects say
otherwise. The route changes storeys by the building's stairs; the sensor rises along the flight's slope, as if carried
or on legs, and on wheels tilts with it by a small part of its angle.
"""

from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.point_times import Stamped
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.carriers import WHEELED, Carrier
from data.simulation.changes import AS_PLANNED, Changes
from data.simulation.drive import plan_drive
from data.simulation.effects import Timing, checked, timing_of
from data.simulation.effects.platforms import RISE
from data.simulation.effects.world import IN_SCENE, Driven, World, furnished, noisy
from data.simulation.imu import imu_named
from data.simulation.route import curve_length
from data.simulation.run import SimulatedRun, Taken, VisitedRoom, write_run
from data.simulation.sensor import VLP_16, Sensor, described
from data.simulation.storey_model import load_storeys
from data.simulation.way import Grids, way_through

TOLERANCE = 0.015  # m, standard deviation of a wall's place by the effect `tolerance`
ON_FLOOR = 0.1  # m from a storey's level, at which the robot is on it
SENSOR_TOP = 0.1  # m: half a sensor's height


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
