"""Scans made worse in one way, in four severities each: by the sensor, its surroundings, its motion or its cable."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from data.scans import Scan
from evaluation.drives.carried import CarriedDrive

Array = NDArray[np.float64]
Perturbation = Literal[
    "dropout", "field of view", "noise", "occlusion", "sparsity", "motion distortion", "people", "vibration", "gaps",
]  # fmt: skip
PERTURBATIONS: tuple[Perturbation, ...] = get_args(Perturbation)
SEVERITIES: dict[Perturbation, tuple[float, float, float, float]] = {
    "dropout": (0.3, 0.6, 0.8, 0.95),  # of the returns are lost, at random
    "field of view": (270.0, 180.0, 120.0, 70.0),  # degrees that are left of the horizontal one
    "noise": (0.02, 0.05, 0.1, 0.2),  # m, standard deviation of each range
    "occlusion": (0.15, 0.3, 0.5, 0.7),  # of the directions are blocked by things near the sensor
    "sparsity": (0.75, 0.5, 0.25, 0.125),  # of the beams are left
    "motion distortion": (1.0, 1.5, 2.0, 3.0),  # times the pace of a recorded hand, the points' times not given
    "people": (2.0, 5.0, 10.0, 20.0),  # walk round the sensor
    "vibration": (0.2, 0.5, 1.0, 2.0),  # degrees of amplitude
    "gaps": (1.0, 2.0, 4.0, 8.0),  # of 2 s without a scan
}
BEAM_RAD = float(np.radians(2.0))  # one beam of 16
BLOCKS, BLOCK_S, BLOCK_M = 12, 2.0, (0.4, 0.8)  # directions that are blocked together, for how long, how near
PERSON_RADIUS_M, PERSON_NEAR_M, PERSON_FAR_M = 0.25, 0.8, 4.0
PERSON_BELOW_M, PERSON_ABOVE_M = 1.4, 0.4  # of a sensor that is carried in a hand
PERSON_SPEED = 0.8  # m/s
VIBRATION_HZ = 12.0
GAP_S, FIRST_GAP_S = 2.0, 5.0


@dataclass(frozen=True, eq=False)
class Perturbed:
    """A drive whose scans are perturbed, the same at each reading. `severity` counts from 1; 0 leaves them as they are.

    Motion distortion is not of the scans: it is in how they are taken (`pace_of`).
    """

    drive: CarriedDrive
    perturbation: Perturbation
    severity: int

    def scans(self, count: int | None = None) -> Iterator[Scan]:
        """Those of the drive, or of its first `count`, without what falls in a gap."""
        change = _CHANGES.get(self.perturbation)
        for scan in self.drive.scans(count):
            if not self._in_gap(scan.stamp_ns):
                yield scan if change is None or self.severity == 0 else change(scan, self.amount, self)

    @property
    def amount(self) -> float:
        """In the perturbation's own unit."""
        return SEVERITIES[self.perturbation][self.severity - 1]

    def _in_gap(self, stamp_ns: int) -> bool:
        """The gaps lie evenly from `FIRST_GAP_S` on."""
        if self.perturbation != "gaps" or self.severity == 0:
            return False
        end_s = self.drive.count * self.drive.period_s
        apart = (end_s - FIRST_GAP_S) / self.amount
        late = stamp_ns / 1e9 - FIRST_GAP_S
        return late >= 0 and late % apart < GAP_S

    def rng(self, *of: int) -> np.random.Generator:
        """Random numbers that are the same at each reading."""
        return np.random.default_rng([PERTURBATIONS.index(self.perturbation), self.severity, *of])


def pace_of(perturbation: Perturbation, severity: int) -> float:
    """The pace of the recorded motion under a motion distortion."""
    return SEVERITIES[perturbation][severity - 1] if severity else 1.0


def _kept(scan: Scan, keep: NDArray[np.bool_]) -> Scan:
    """The points of a scan that are left; the first one if none would be."""
    keep = keep if keep.any() else np.arange(len(keep)) == 0
    times = None if scan.point_times is None else scan.point_times[keep]
    return replace(scan, points=np.ascontiguousarray(scan.points[keep]), point_times=times)


def _dropout(scan: Scan, share: float, of: Perturbed) -> Scan:
    return _kept(scan, of.rng(scan.index).random(len(scan.points)) >= share)


def _field_of_view(scan: Scan, degrees: float, of: Perturbed) -> Scan:
    return _kept(scan, np.abs(_azimuth(scan.points)) <= np.radians(degrees) / 2)


def _noise(scan: Scan, sigma: float, of: Perturbed) -> Scan:
    ranges = np.linalg.norm(scan.points, axis=1)
    noisy = np.maximum(ranges + of.rng(scan.index).normal(0.0, sigma, len(ranges)), 0.0)
    return replace(scan, points=scan.points * (noisy / ranges)[:, None])


def _occlusion(scan: Scan, share: float, of: Perturbed) -> Scan:
    """Screens stand near the sensor; after `BLOCK_S` they stand in other directions."""
    rng = of.rng(int(scan.stamp_ns / 1e9 / BLOCK_S))
    blocked = rng.permutation(BLOCKS) < round(share * BLOCKS)
    near = rng.uniform(*BLOCK_M, BLOCKS)
    block = ((_azimuth(scan.points) + np.pi) / (2 * np.pi) * BLOCKS).astype(int) % BLOCKS
    ranges = np.linalg.norm(scan.points, axis=1)
    shown = np.where(blocked[block], np.minimum(near[block], ranges), ranges)
    return replace(scan, points=scan.points * (shown / ranges)[:, None])


def _sparsity(scan: Scan, share: float, of: Perturbed) -> Scan:
    elevation = np.arctan2(scan.points[:, 2], np.linalg.norm(scan.points[:, :2], axis=1))
    beam = np.round((elevation + np.pi / 2) / BEAM_RAD)
    return _kept(scan, np.floor((beam + 1) * share) > np.floor(beam * share))


def _people(scan: Scan, count: float, of: Perturbed) -> Scan:
    """People walk in circles round the sensor; those behind a wall hide nothing."""
    rng = of.rng()
    circle = rng.uniform(PERSON_NEAR_M, PERSON_FAR_M, int(count))
    turns = rng.choice([-1.0, 1.0], int(count)) * PERSON_SPEED / circle
    angles = rng.uniform(0.0, 2 * np.pi, int(count)) + turns * scan.stamp_ns / 1e9
    centres = circle[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    R_bim_sensor = of.drive.truth.at(scan.stamp_ns + _times_ns(scan))[:, :3, :3]
    rays = np.einsum("nij,nj->ni", R_bim_sensor, scan.points)
    shown = np.min([_share_before(rays, centre) for centre in centres], axis=0)
    return replace(scan, points=scan.points * shown[:, None])


def _share_before(rays: Array, centre: Array) -> Array:
    """(N,) the share of each ray (N, 3), from the sensor and level, before it meets a person; 1 if it does not."""
    flat = rays[:, :2]
    a, b = (flat**2).sum(axis=1), flat @ centre
    under = b**2 - a * (centre @ centre - PERSON_RADIUS_M**2)
    met = (b - np.sqrt(np.maximum(under, 0.0))) / np.maximum(a, 1e-9)
    height = met * rays[:, 2]
    hit = (under > 0) & (met > 0) & (met < 1) & (height > -PERSON_BELOW_M) & (height < PERSON_ABOVE_M)
    return np.where(hit, met, 1.0)


def _vibration(scan: Scan, degrees: float, of: Perturbed) -> Scan:
    """The sensor turns to and fro about its x and y axes as it measures."""
    phase = 2 * np.pi * VIBRATION_HZ * (scan.stamp_ns + _times_ns(scan)) / 1e9
    turn = np.radians(degrees) * np.column_stack([np.sin(phase), np.sin(0.83 * phase + 1.0), np.zeros(len(phase))])
    return replace(scan, points=scan.points - np.cross(turn, scan.points))


def _azimuth(points: Array) -> Array:
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]))


def _times_ns(scan: Scan) -> NDArray[np.int64]:
    """When each point was measured, after the stamp."""
    if scan.point_times is None:
        return np.zeros(len(scan.points), np.int64)
    return np.asarray(np.round(1e9 * scan.point_times), np.int64)


_CHANGES: dict[Perturbation, Callable[[Scan, float, Perturbed], Scan]] = {
    "dropout": _dropout, "field of view": _field_of_view, "noise": _noise, "occlusion": _occlusion,
    "sparsity": _sparsity, "people": _people, "vibration": _vibration,
}  # fmt: skip
