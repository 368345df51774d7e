"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth.

All doors are open (their leaves are left out), furniture is included, window panes are opaque, unless effects say
otherwise. The route changes storeys by the building's stairs; the sensor rises along the flight's slope, as if carried
or on legs, and on wheels tilts with it by a small part of its angle.
"""

from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.carriers import WHEELED, Carrier
from data.simulation.changes import Changes
from data.simulation.drive import Robot, plan_drive
from data.simulation.effects import Timing, checked, timing_of
from data.simulation.imu import imu_named
from data.simulation.run import PLAN, Settings, SimulatedRun, Taken, VisitedRoom, write_run
from data.simulation.sensor import Sensor, SpinningSensor
from data.simulation.sensors import described

if TYPE_CHECKING:
    from data.simulation.building import Grids

__all__ = ["PLAN", "ROBOT", "ROBOT_TOP", "SENSOR", "SimulatedRun", "VisitedRoom", "simulate"]

SENSOR = SpinningSensor()
ROBOT = WHEELED.robot
ROBOT_TOP = WHEELED.top  # m above the floor: the robot passes under what is higher, unless its sensor is higher still
ON_FLOOR = 0.1  # m from a storey's level, at which the robot is on it
SENSOR_TOP = 0.1  # m: half a sensor's height


def simulate(
    ifc: Path | str,
    storey: str | Sequence[str],
    out_dir: Path | str,
    seed: int = 0,
    min_rooms: int = 8,
    min_length: float = 120.0,
    sensor: Sensor = SENSOR,
    robot: Robot | None = None,
    sensor_height: float | None = None,
    scan_format: str | None = None,
    changes: Changes | None = None,
    and_back: bool = False,
    carrier: Carrier = WHEELED,
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    effects: Collection[str] = (),
    seconds: float | None = None,
    imu: str | None = None,
) -> SimulatedRun:
    """Drives through a storey's open doors, from a random place and heading, and writes scans and truth.

    `ifc` may also be a building's mesh (see `data.plans.mesh_plan`); `storey` is then the name of one of its levels, or
    empty for the lowest. Several storeys are driven in the given order; a storey named again is visited again.

    The robot enters `min_rooms` rooms (all, if fewer can be reached), drives at least `min_length` metres, and returns
    (on each of several storeys, before it takes the stairs); `seconds` ends the drive before. The sensor is taken by
    the `carrier`, `sensor_height` metres above the storey's floor; it is turned in it by roll, pitch and yaw
    `mount_deg`: R_carrier_sensor = Rz(yaw) Ry(pitch) Rx(roll). `changes` are made to the building, not to its plan, and
    need a drive on one storey. With `and_back` the whole route is then driven in reverse, so that every place is seen
    twice. `effects` are names of `data.simulation.effects`. In a rolling scan the sensor moves while it measures: the
    scan's stamp and true pose are those of its first ray. `robot`, `sensor_height` and `scan_format` are the carrier's
    own and `bin` (`ply` for points with times) where not given. `imu` names a class of inertial measurement unit
    (`data.simulation.imu`) in the sensor, whose samples are written to `imu.csv` beside the scans. The same seed gives
    the same bytes.

    Raises UserError for an unreadable IFC file, an unknown storey, one on which the robot cannot move, storeys without
    stairs that it can climb, an `out_dir` that is not empty, and impossible settings.
    """
    from data.geometry.raycast import TriangleScene
    from data.simulation.building import legs_over, storeys_as_built
    from data.simulation.effects.furnishing import IN_SCENE, Driven, furnished
    from data.simulation.effects.platforms import RISE, platforms
    from data.simulation.effects.returns import noisy
    from data.simulation.effects.world import World
    from data.simulation.occupancy import build_grid
    from data.simulation.route import curve_length

    chosen = checked(effects)
    timing, unit = timing_of(chosen, carrier.rolling), None if imu is None else imu_named(imu)
    scan_format = scan_format or ("ply" if timing == "rolling" else "bin")
    robot, height = robot or carrier.robot, carrier.height if sensor_height is None else sensor_height
    sensor = noisy(sensor) if "returns" in chosen else sensor
    out = Path(out_dir)
    _check(out, scan_format, height, seed, timing, seconds)
    models = storeys_as_built(ifc, [storey] if isinstance(storey, str) else list(storey), changes, seed, chosen)
    scene = TriangleScene(np.concatenate([m.solid for m in dict.fromkeys(models)]))
    grids = {m: build_grid(m, scene, max(carrier.top, height + SENSOR_TOP)) for m in dict.fromkeys(models)}
    rng = np.random.default_rng(seed)
    start_yaw = float(rng.uniform(-np.pi, np.pi))
    legs = legs_over(models, grids, scene, robot.radius, min_rooms, min_length, rng)
    if and_back:
        legs = (*legs, *(leg[::-1] for leg in reversed(legs)))
    raised = platforms(models, legs, scene, seed) if "steps" in chosen else None
    if raised is not None:
        legs = tuple(raised.over(leg, models[0].level) for leg in legs)
    motion = carrier.motion(plan_drive(legs, start_yaw, robot), models[0].level, height, seed)
    taken = Taken(sensor, motion, mount_deg, timing, unit)
    truth = taken.truth(seconds)
    stamps = truth.stamps_ns / 1e9
    way = motion.ground(stamps)
    length = sum(map(curve_length, legs)) if seconds is None else curve_length(way[:, :2])
    visited = _visited(grids, stamps, way, ON_FLOOR if raised is None else ON_FLOOR + RISE)
    run = SimulatedRun(
        out, models[0].name, seed, length, start_yaw, visited, truth,
        models[0].changes, tuple(model.name for model in models),
    )  # fmt: skip
    settings: Settings = {"bim": Path(ifc).name, "sensor": described(sensor), "robot": asdict(robot)}
    settings |= {"sensor_height_m": height, "rolling": timing != "snapshots", "times_told": timing == "rolling"}
    settings |= {"carrier": carrier.name, "mount_deg": list(mount_deg), "effects": sorted(chosen)}
    settings |= {} if imu is None else {"imu": imu}
    drive = Driven(grids, legs, motion, tuple(room.id for room in visited), float(stamps[-1]), robot.radius)
    world = furnished(chosen, drive, raised, sensor.beams, seed) if chosen & IN_SCENE else World(scene)
    write_run(run, taken, world, scan_format, settings, ifc)
    return run


def _check(
    out: Path, scan_format: str, sensor_height: float, seed: int, timing: Timing, seconds: float | None
) -> None:
    if scan_format not in SCAN_WRITERS:
        raise UserError(f"scan format '{scan_format}' is not known; take one of {', '.join(SCAN_WRITERS)}")
    if timing == "rolling" and scan_format not in WITH_TIMES:
        raise UserError(
            f"the sensor moves during a scan, and {scan_format} files hold no times of points; write "
            f"{' or '.join(WITH_TIMES)}, or leave them out by the effect 'untimed'"
        )
    if not 0 < sensor_height < 10:
        raise UserError(f"a sensor height of {sensor_height} m cannot be; give metres above the floor")
    if seconds is not None and not seconds > 0:
        raise UserError(f"a drive of {seconds:g} s cannot be; give seconds above 0")
    if seed < 0:
        raise UserError(f"the seed {seed} is negative; give 0 or more")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"{out}: exists already and is not an empty folder; give another one")


def _visited(
    grids: "Grids", stamps: NDArray[np.float64], poses: NDArray[np.float64], highest: float
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
