"""A case (which building, who carries which sensor, what goes wrong, what is run), and its drive.

Drives are simulated once for all cases that share one, and deleted after the last of them.
"""

import pickle
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PositiveFloat

from data.common.build import PRODUCT
from data.common.errors import UserError
from data.common.files import write_atomically
from data.imu import ImuSamples, read_imu
from data.scans import Scan, ScanFolder
from data.simulation import Change
from data.simulation.changes import AS_PLANNED
from data.simulation.simulate import IMU
from data.trajectory import Trajectory
from evaluation.buildings import building_file, building_named, locked
from evaluation.conditions import BEGINS, BUILDING
from evaluation.study import Case, Options, key_of

RECORDING = "../shared/data/motion/handheld_survey.tum"
"""The motion of a hand-held scanner in a real building."""
ONE_MORE_S = 0.2  # the truth reaches beyond the end of the last scan
ON_EACH_STOREY = {"min_rooms": 4, "min_length": 30.0}  # rooms and metres of a whole tour
Degrees = tuple[float, float, float]


class DriveCase(Case):
    """A run on a drive through a building.

    The drive has the first `seconds` of a tour, or with None the whole tour of `storeys`. `carrier` is one of the
    simulator's or a recorded motion FILE.tum, which may be played at another `pace` or `backwards`. `mount_deg` are
    roll, pitch and yaw of the sensor on its carrier. The sensor moves within each scan; without `times`, it is unknown
    when the points were measured. `imu` is a class of IMUs in the sensor. The building differs from its plan by
    `changes`; `trouble` is what is wrong with sensor, recording or plan, with its severity (`evaluation.conditions`).
    `variant` is what is run (`evaluation.variants`).
    """

    building: str
    seed: int = 0
    carrier: str = "wheeled"
    pace: PositiveFloat = 1.0
    backwards: bool = False
    mount_deg: Degrees = (0.0, 0.0, 0.0)
    sensor: str = "VLP-16"
    times: bool = True
    imu: str | None = None
    effects: tuple[str, ...] = ()
    changes: str = ""
    seconds: float | None = Field(60.0, ge=5.0)
    storeys: tuple[str, ...] = ()
    trouble: str = ""
    variant: str = "anchored"

    @property
    def group(self) -> str:
        """The fields of the simulated drive: cases of one drive share its scans."""
        shaken = {"trouble": "shaken"} if self.trouble == "shaken" else {}
        return key_of(self.model_dump(mode="json", exclude={"times", "trouble", "variant"}) | shaken)

    @property
    def depends(self) -> tuple[str, ...]:
        """What is not ours changes with the simulator alone."""
        from evaluation.variants import PEERS

        return ("data",) if self.variant in PEERS else PRODUCT

    def files(self) -> set[str]:
        """The building's file, a recorded motion, and the weights that a variant names."""
        weights = self.variant.partition("@")[2]
        named = {self.carrier} if self.carrier.endswith(".tum") else set()
        return building_named(self.building).files() | named | ({weights} if "/" in weights else set())


class DriveOptions(Options):
    """Which `buildings` are driven through with which `seeds`, for how many `seconds`."""

    buildings: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)
    seconds: PositiveFloat = 60.0

    def drives(self) -> Iterator[dict[str, Any]]:
        """The fields of each drive. Raises UserError for an unknown building."""
        for building, seed in product(self.buildings, self.seeds):
            yield {"building": building_named(building).name, "seed": seed, "seconds": self.seconds}

    def in_turn(self, cells: Sequence[dict[str, Any]], per_cell: int | None) -> Iterator[dict[str, Any]]:
        """Each of the `cells` of a design with the next `per_cell` of all drives in random order, again and again; with
        all of them for None."""
        drives = list(self.drives())
        order, each = np.random.default_rng(0).permutation(len(drives)), per_cell or len(drives)
        for number, cell in enumerate(cells):
            for k in range(number * each, (number + 1) * each):
                yield {**drives[order[k % len(drives)]], **cell}


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
    from data.simulation.carriers import carrier_named
    from data.simulation.sensor import sensor_named
    from data.simulation.simulate import simulate

    bim, storey = building_file(case.building, work)
    carrier = carrier_named(case.carrier, case.pace, case.backwards)
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
        changes=BUILDING.get(case.changes, AS_PLANNED),
        imu=case.imu,
        shaken_from=BEGINS * (case.seconds or 0.0) if case.trouble == "shaken" else None,
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
