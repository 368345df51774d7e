"""Short drives with any carrier, mount, sensor and effect; their scans are deleted when they were used."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from pydantic import Field, PositiveFloat

from data.imu import ImuSamples, read_imu
from data.scans import Scan, ScanFolder
from data.simulation import Change, Changes
from data.simulation.carriers import Shaken, carrier_named
from data.simulation.run import IMU
from data.simulation.sensors import sensor_named
from data.trajectory import Trajectory
from evaluation.drives.sequences import DriveCase, building_of

Degrees = tuple[float, float, float]
LEVEL: Degrees = (0.0, 0.0, 0.0)
ONE_MORE_S = 0.2  # the truth reaches beyond the end of the last scan


class CarriedCase(DriveCase):
    """The first `seconds` of a drive through a building.

    `carrier` is one of the simulator's or a recorded motion FILE.tum, which may be played at another `pace` or
    `backwards`. `mount_deg` are roll, pitch and yaw of the sensor on its carrier. The sensor moves within each scan;
    without `times`, it is unknown when the points were measured.
    """

    carrier: str
    pace: PositiveFloat = 1.0
    backwards: bool = False
    mount_deg: Degrees = LEVEL
    sensor: str
    effects: tuple[str, ...] = ()
    times: bool = True
    seconds: float = Field(ge=5.0)

    @property
    def recorded(self) -> bool:
        """Whether the motion is a recorded one."""
        return self.carrier.endswith(".tum")

    def files(self) -> set[str]:
        """The building's file and the recording."""
        return super().files() | ({self.carrier} if self.recorded else set())


@dataclass(frozen=True, eq=False)
class CarriedDrive:
    """A simulated drive of `count` scans over `length` metres; `truth` is T_bim_sensor at the scans' stamps, and at
    some after them. `changes` are the differences of the building from its `plan`, a file, and `stands_off` how far
    each wall is off its place besides."""

    folder: Path
    truth: Trajectory
    count: int
    length: float
    times: bool
    changes: tuple[Change, ...] = ()
    stands_off: tuple[Change, ...] = ()
    plan: Path = Path()

    @property
    def period_s(self) -> float:
        """Seconds from scan to scan, which is how long each takes."""
        return float(np.median(np.diff(self.truth.stamps_ns)) / 1e9)

    @property
    def samples(self) -> ImuSamples:
        """Those of the IMU, in the sensor's axes. Raises UserError if the sensor has none."""
        return read_imu(self.folder / IMU)

    def scans(self, count: int | None = None) -> Iterator[Scan]:
        """Reads the scans, or the first `count`, one by one; with their points' times only if these are given."""
        for scan in islice(ScanFolder(self.folder), self.count if count is None else count):
            yield scan if self.times else replace(scan, point_times=None)


@contextmanager
def carried(
    case: CarriedCase,
    work: Path,
    shaken_from: float | None = None,
    changes: Changes | None = None,
    imu: str | None = None,
) -> Iterator[CarriedDrive]:
    """Simulates the drive in a folder within `work` that is deleted at the end: all drives of a study take hundreds of
    gigabytes, and to simulate one is quicker than to track it. The sensor is shaken from the second `shaken_from` on.
    `changes` are made to the building, not to its plan. `imu` names a class of IMU in the sensor.

    Raises UserError as the simulator does.
    """
    from data.simulation.simulate import simulate

    bim, storey = building_of(case.sequence, work)
    carrier = carrier_named(case.carrier, case.pace, case.backwards)
    carrier = carrier if shaken_from is None else Shaken(carrier, shaken_from)
    with TemporaryDirectory(prefix="carried.", dir=work) as name:
        run = simulate(
            bim, storey, Path(name) / "drive", case.seed, min_rooms=1, min_length=case.seconds * carrier.robot.speed,
            sensor=sensor_named(case.sensor), carrier=carrier, mount_deg=case.mount_deg,
            effects=("rolling", *case.effects), seconds=case.seconds + ONE_MORE_S, changes=changes, imu=imu,
        )  # fmt: skip
        count = int(np.searchsorted(run.truth.stamps_ns, round(case.seconds * 1e9)))
        yield CarriedDrive(
            run.out_dir / "scans", run.truth, count, run.length, case.times, run.changes, run.stands_off,
            run.plan or bim,
        )  # fmt: skip
