"""Simulates a drive through a building: a route through its rooms, scans along it, and the truth.

All doors are open (their leaves are left out), furniture is included, window panes are opaque, unless effects say
otherwise. The route changes storeys by the building's stairs; the sensor rises along the flight's slope, as if carried
or on legs, and on wheels tilts with it by a small part of its angle.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.scans.point_times import Stamped
from data.simulation.carriers import WHEELED, Carrier
from data.simulation.changes import Changes
from data.simulation.drive import Robot, plan_drive
from data.simulation.drive_setup import Setup, check, set_up, settings_of
from data.simulation.run import PLAN, SimulatedRun, Taken, VisitedRoom, write_run
from data.simulation.sensor import Sensor, SpinningSensor

if TYPE_CHECKING:
    from data.simulation.building import Grids, Way
    from data.simulation.effects.world import World
    from data.simulation.storey_model import StoreyModel

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
    stamped: Stamped = "start",
) -> SimulatedRun:
    """Drives through a storey's open doors, from a random place and heading, and writes scans and ground truth.

    `ifc` may also be a building's mesh (see `data.plans.mesh_plan`); `storey` is then the name of one of its levels, or
    empty for the lowest. Several storeys are driven in the given order; a storey named again is visited again.

    The robot enters `min_rooms` rooms (all, if fewer can be reached), drives at least `min_length` metres, and returns
    (on each of several storeys, before it takes the stairs); `seconds` ends the drive earlier. The `carrier` holds the
    sensor `sensor_height` metres above the storey's floor, turned by roll, pitch and yaw `mount_deg`:
    R_carrier_sensor = Rz(yaw) Ry(pitch) Rx(roll). `changes` are made to the building, not to its plan, and need a drive
    on one storey. With `and_back`, the whole route is then driven in reverse, so that every place is seen twice.
    `effects` are names of `data.simulation.effects`. In a rolling scan, the sensor moves while it measures: the scan's
    stamp and true pose are those of its first ray, or of the instant `stamped`. By default, `robot` and `sensor_height`
    are the carrier's, and `scan_format` is `bin` (`ply` for points with times). `imu` names a class of inertial
    measurement units (`data.simulation.imu`); the samples of one in the sensor are written to `imu.csv` beside the
    scans. The same seed gives the same bytes.

    Raises UserError for an unreadable IFC file, an unknown storey or one on which the robot cannot move, storeys
    without stairs that it can climb, an `out_dir` that is not empty, and impossible settings.
    """
    from data.simulation.building import storeys_as_built, way_through

    setup = set_up(carrier, sensor, robot, sensor_height, scan_format, effects, imu)
    out = Path(out_dir)
    check(out, setup, seed, seconds, stamped)
    storeys = [storey] if isinstance(storey, str) else list(storey)
    models = storeys_as_built(ifc, storeys, changes, seed, setup.effects)
    top, has_steps = max(carrier.top, setup.height + SENSOR_TOP), "steps" in setup.effects
    way = way_through(models, top, setup.robot, min_rooms, min_length, and_back, has_steps, seed)
    drive = plan_drive(way.legs, way.start_yaw, setup.robot)
    motion = carrier.motion(drive, models[0].level, setup.height, seed)
    taken = Taken(setup.sensor, motion, mount_deg, setup.timing, setup.unit, stamped)
    run = _driven(out, models, way, taken, seed, seconds)
    settings = settings_of(ifc, carrier, setup, mount_deg, imu)
    write_run(run, taken, _world(way, run, taken, setup, seed), setup.scan_format, settings, ifc)
    return run


def _driven(
    out: Path, models: "list[StoreyModel]", way: "Way", taken: Taken, seed: int, seconds: float | None
) -> SimulatedRun:
    """The run: its truth, its length, and the rooms that it enters."""
    from data.simulation.effects.platforms import RISE
    from data.simulation.route import curve_length

    truth = taken.truth(seconds)
    stamps = truth.stamps_ns / 1e9
    ground = taken.motion.ground(stamps)
    length = sum(map(curve_length, way.legs)) if seconds is None else curve_length(ground[:, :2])
    visited = _visited(way.grids, stamps, ground, ON_FLOOR if way.raised is None else ON_FLOOR + RISE)
    names = tuple(model.name for model in models)
    off = tuple(change for model in models for change in model.stands_off)
    return SimulatedRun(out, models[0].name, seed, length, way.start_yaw, visited, truth, models[0].changes, names, off)


def _world(way: "Way", run: SimulatedRun, taken: Taken, setup: Setup, seed: int) -> "World":
    """The building in which the drive is measured, with the effects that add to it."""
    from data.simulation.effects.furnishing import IN_SCENE, Driven, furnished
    from data.simulation.effects.world import World

    if not setup.effects & IN_SCENE:
        return World(way.scene)
    rooms = tuple(room.id for room in run.rooms)
    end = float(run.truth.stamps_ns[-1] / 1e9)
    drive = Driven(way.grids, way.legs, taken.motion, rooms, end, setup.robot.radius)
    return furnished(setup.effects, drive, way.raised, setup.sensor.beams, seed)


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
