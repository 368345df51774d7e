"""Drives: simulated once for all cases that share one, and deleted after the last of them."""

import fcntl
import pickle
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically
from data.imu import ImuSamples, read_imu
from data.plans import load_bim
from data.plans.mesh_files import is_mesh
from data.scans import Scan, ScanFolder
from data.scene_graph import SceneGraph
from data.simulation import Change
from data.simulation.run import IMU
from data.trajectory import Trajectory
from evaluation.cases import GENERATED, PLAN, DriveCase, building_named
from evaluation.conditions import BEGINS, BUILDING

ONE_MORE_S = 0.2  # the truth reaches beyond the end of the last scan
ON_EACH_STOREY = {"min_rooms": 4, "min_length": 30.0}  # rooms and metres of a whole tour


@dataclass(frozen=True, eq=False)
class Drive:
    """A simulated drive of `count` scans over `length_m` metres, through `rooms` (id, second of entering). `truth` is
    T_bim_sensor at the scans' stamps, and at some after them. `changes` are the differences of the building from its
    `plan`, a file, and `stands_off` how far each wall is off its place besides; `bim` is the file of the building,
    `height_m` that of the sensor above the floor."""

    folder: Path
    truth: Trajectory
    count: int
    length_m: float
    height_m: float
    bim: Path
    plan: Path
    storey: str
    rooms: tuple[tuple[str, float], ...]
    changes: tuple[Change, ...] = ()
    stands_off: tuple[Change, ...] = ()

    @property
    def period_s(self) -> float:
        """Seconds from scan to scan, which is how long each takes."""
        return float(np.median(np.diff(self.truth.stamps_ns)) / 1e9)

    @property
    def samples(self) -> ImuSamples:
        """Those of the IMU, in the sensor's axes. Raises UserError if the sensor has none."""
        return read_imu(self.folder / IMU)

    def scans(self, count: int | None = None, times: bool = True) -> Iterator[Scan]:
        """Reads the scans, or the first `count`, one by one; with their points' times only if these are given."""
        for scan in islice(ScanFolder(self.folder), self.count if count is None else count):
            yield scan if times else replace(scan, point_times=None)


def drive_of(case: DriveCase, work: Path) -> Drive:
    """The drive of a case, simulated in `work` if it is missing. Raises UserError as the simulator does."""
    folder = _folder(case, work)
    with locked(folder):
        if not (folder / "drive.pickle").exists():
            shutil.rmtree(folder, ignore_errors=True)  # of an interrupted simulation
            write_atomically(folder.with_suffix(".pickle"), pickle.dumps(_simulated(case, work, folder)))
            folder.with_suffix(".pickle").rename(folder / "drive.pickle")
        return pickle.loads((folder / "drive.pickle").read_bytes())  # type: ignore[no-any-return]


def release(case: DriveCase, work: Path) -> None:
    """Deletes the drive of a case: those of a study take hundreds of gigabytes, and are simulated faster than run."""
    shutil.rmtree(_folder(case, work), ignore_errors=True)


def _folder(case: DriveCase, work: Path) -> Path:
    return work / "drives" / blake2b(case.group.encode(), digest_size=8).hexdigest()


def _simulated(case: DriveCase, work: Path, folder: Path) -> Drive:
    from data.simulation.carriers import Shaken, carrier_named
    from data.simulation.sensors import sensor_named
    from data.simulation.simulate import simulate

    bim, storey = building_file(case.building, work)
    carrier = carrier_named(case.carrier, case.pace, case.backwards)
    if case.trouble == "shaken":
        carrier = Shaken(carrier, BEGINS * (case.seconds or 0.0))
    if case.changes and case.changes not in BUILDING:
        raise UserError(f"changes '{case.changes}': no such changes of a building; use {', '.join(BUILDING)}")
    whole = case.seconds is None
    run = simulate(
        bim,
        case.storeys or storey,
        folder,
        case.seed,
        **(ON_EACH_STOREY if whole else {"min_rooms": 1, "min_length": case.seconds * carrier.robot.speed}),  # type: ignore
        sensor=sensor_named(case.sensor),
        carrier=carrier,
        mount_deg=case.mount_deg,
        effects=("rolling", *case.effects),
        seconds=None if whole else case.seconds + ONE_MORE_S,  # type: ignore[operator]
        changes=BUILDING.get(case.changes),
        imu=case.imu,
    )
    stamps = run.truth.stamps_ns
    count = len(stamps) if case.seconds is None else int(np.searchsorted(stamps, round(case.seconds * 1e9)))
    rooms = tuple((room.id, room.entered_s) for room in run.rooms)
    return Drive(
        folder / "scans",
        run.truth,
        count,
        run.length,
        carrier.height,
        bim,
        run.plan or bim,
        storey,
        rooms,
        run.changes,
        run.stands_off,
    )


def building_file(name: str, work: Path) -> tuple[Path, str]:
    """A building's file and the name of its storey; those that are made are written to `work` once.

    Raises UserError for an unknown one.
    """
    building = building_named(name)
    if building.bim == "demo":
        from data.generation.demo_building import DEMO_STOREY, write_demo_building

        path = work / "demo.ifc"
        with locked(path):
            if not path.exists():
                write_demo_building(path)
        return path, building.storey or DEMO_STOREY
    if not building.bim.startswith((GENERATED, PLAN)):
        return Path(building.bim), building.storey or ""
    from data.generation.plan_mesh import write_plan_mesh

    path = work / f"{blake2b(building.bim.encode(), digest_size=6).hexdigest()}.stl"
    with locked(path):
        if not path.exists():
            write_plan_mesh(_plan_named(building.bim), path)
    return path, ""


def _plan_named(bim: str) -> SceneGraph:
    from data.generation.buildings import KINDS, generate_plan
    from data.plans import read_plans

    if bim.startswith(GENERATED):
        kind, _, seed = bim.removeprefix(GENERATED).rpartition("_")
        if kind not in KINDS or not seed.isdecimal():
            raise UserError(f"no building '{bim}'; give {GENERATED}KIND_SEED with a kind of {', '.join(KINDS)}")
        return generate_plan(kind, int(seed)).graph
    file, _, name = bim.removeprefix(PLAN).partition("#")
    plans = {plan.name: plan.graph for plan in read_plans(Path(file))}
    if name not in plans:
        raise UserError(f"{file}: no plan '{name}'; there are {', '.join(list(plans)[:5])}, ...")
    return plans[name]


def plan_graph(bim: Path) -> SceneGraph:
    """The A-graph of a building's file or mesh."""
    if is_mesh(bim):
        from data.plans.mesh_plan import read_mesh

        return read_mesh(bim).graph
    return load_bim(bim).graph


def storey_of(a_graph: SceneGraph, T_bim_sensor: NDArray[np.float64]) -> str | None:
    """The id of the storey whose floor is next below a sensor pose (4, 4); None if there is none."""
    below = [f for f in a_graph.floors if f.elevation is not None and f.elevation <= T_bim_sensor[2, 3]]
    return max(below, key=lambda f: f.elevation or 0.0).id if below else None


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """A context that one process at a time may enter for this path, by a file `.NAME.lock` beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(f".{path.name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
