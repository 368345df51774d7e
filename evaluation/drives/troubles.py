"""What goes wrong with a recording: scans mirrored, in a wrong unit, the sensor covered, carried elsewhere, shaken."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedDrive

Array = NDArray[np.float64]
Trouble = Literal["none", "mirrored", "feet", "covered", "kidnapped", "shaken", "foreign", "wrong storey"]
TROUBLES: tuple[Trouble, ...] = get_args(Trouble)
NO_PLACE: frozenset[Trouble] = frozenset({"mirrored", "feet", "foreign"})  # no place in the plan is right

BEGINS = 0.4  # of the drive: where the sensor is covered, carried elsewhere or shaken
COVERED_S, CARRIED_S = 5.0, 12.0
COVER = 0.15, 0.25  # m from the sensor: a hand or a cap
FEET = 1 / 0.3048


@dataclass(frozen=True, eq=False)
class TroubledDrive:
    """Scans as the system gets them, and the true T_bim_sensor at their stamps."""

    drive: CarriedDrive
    trouble: Trouble
    seconds: float

    @property
    def _begin_ns(self) -> int:
        return round(1e9 * BEGINS * self.seconds)

    @property
    def _gap_ns(self) -> int:
        """How long no scan comes, as the sensor is carried elsewhere."""
        return round(1e9 * CARRIED_S) if self.trouble == "kidnapped" else 0

    @property
    def truth(self) -> Trajectory:
        """At the stamps of `scans`."""
        stamps, poses = self.drive.truth.stamps_ns, self.drive.truth.poses
        before, after = stamps < self._begin_ns, stamps >= self._begin_ns + self._gap_ns
        told = np.concatenate([stamps[before], stamps[after] - self._gap_ns])
        return Trajectory(told, np.concatenate([poses[before], poses[after]]))

    def scans(self) -> Iterator[Scan]:
        """The scans; after a gap, the stamps go on as if there were none."""
        rng = np.random.default_rng(0)
        for scan in self.drive.scans():
            late = scan.stamp_ns - self._begin_ns
            if 0 <= late < self._gap_ns:
                continue
            told = replace(scan, stamp_ns=scan.stamp_ns - self._gap_ns * (late >= 0))
            if self.trouble == "mirrored":
                told = replace(told, points=scan.points * [1.0, -1.0, 1.0])
            elif self.trouble == "feet":
                told = replace(told, points=scan.points * FEET)
            elif self.trouble == "covered" and 0 <= late < 1e9 * COVERED_S:
                told = replace(told, points=_cover(len(scan.points), rng))
            yield told


def _cover(count: int, rng: np.random.Generator) -> Array:
    """(N, 3) points on what is held before the sensor."""
    rays = rng.normal(size=(count, 3))
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True) * rng.uniform(*COVER, (count, 1)))
