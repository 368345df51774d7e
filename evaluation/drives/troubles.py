"""What goes wrong with a recording or its plan.

Scans are mirrored or in a wrong unit; the sensor is covered, carried elsewhere or shaken; the plan is of another
building or of two equal ones. For comparison, scans are turned by the true attitude.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.scans import Scan
from data.scene_graph import Room, WallSurface, Xy
from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedDrive
from sgslam.geometry.frames import level_at

Array = NDArray[np.float64]
Trouble = Literal[
    "none", "levelled", "mirrored", "feet", "covered", "kidnapped", "shaken", "foreign", "twin", "wrong storey"
]
TROUBLES: tuple[Trouble, ...] = get_args(Trouble)
# no place in the plan is right, or none is better than another
NO_PLACE: frozenset[Trouble] = frozenset({"mirrored", "feet", "foreign", "twin"})

BEGINS = 0.4  # of the drive: where the sensor is covered, carried elsewhere or shaken
COVERED_S, CARRIED_S = 5.0, 12.0
COVER = 0.15, 0.25  # m from the sensor: a hand or a cap
FEET = 1 / 0.3048
TWIN_GAP = 5.0  # m between two equal buildings
_TURN_NS = 2_000_000  # in which the attitude is taken as steady


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
        passed = np.concatenate([stamps[before], stamps[after] - self._gap_ns])
        poses = poses if self.trouble != "levelled" else np.stack([level_at(pose) for pose in poses])
        return Trajectory(passed, np.concatenate([poses[before], poses[after]]))

    def scans(self) -> Iterator[Scan]:
        """The scans; after a gap, the stamps go on as if there were none."""
        rng = np.random.default_rng(0)
        for scan in self.drive.scans():
            late = scan.stamp_ns - self._begin_ns
            if 0 <= late < self._gap_ns:
                continue
            sent = replace(scan, stamp_ns=scan.stamp_ns - self._gap_ns * (late >= 0))
            if self.trouble == "mirrored":
                sent = replace(sent, points=scan.points * [1.0, -1.0, 1.0])
            elif self.trouble == "feet":
                sent = replace(sent, points=scan.points * FEET)
            elif self.trouble == "levelled":
                sent = replace(sent, points=self._levelled(scan))
            elif self.trouble == "covered" and 0 <= late < 1e9 * COVERED_S:
                sent = replace(sent, points=_cover(len(scan.points), rng))
            yield sent

    def _levelled(self, scan: Scan) -> Array:
        """(N, 3) the points as a sensor sees them that is held level, and turns only about the vertical."""
        times = np.zeros(len(scan.points)) if scan.point_times is None else scan.point_times
        moments, which = np.unique(np.round(1e9 * times / _TURN_NS).astype(np.int64), return_inverse=True)
        poses = self.drive.truth.at(scan.stamp_ns + _TURN_NS * moments)
        turns = np.stack([level_at(pose)[:3, :3].T @ pose[:3, :3] for pose in poses])
        return np.asarray(np.einsum("nij,nj->ni", turns[which], scan.points))


def twin_plan(plan: SceneGraph) -> SceneGraph:
    """The plan of two equal buildings side by side: every place in one is as good as that in the other."""
    places = np.array([corner for room in plan.rooms for corner in room.polygon or (room.centroid,)])
    aside = float(np.ptp(places[:, 0])) + TWIN_GAP
    return replace(
        plan,
        rooms=plan.rooms + tuple(_room_aside(room, aside) for room in plan.rooms),
        wall_surfaces=plan.wall_surfaces + tuple(_wall_aside(wall, aside) for wall in plan.wall_surfaces),
        doors=plan.doors + tuple(
            replace(door, id=_twin(door.id), rooms=tuple(map(_twin, door.rooms)), centroid=_aside(door.centroid, aside))
            for door in plan.doors
        ),
    )  # fmt: skip


def _twin(name: str) -> str:
    return f"{name}, twin"


def _aside(place: Xy, aside: float) -> Xy:
    return place[0] + aside, place[1]


def _room_aside(room: Room, aside: float) -> Room:
    polygon = None if room.polygon is None else tuple(_aside(corner, aside) for corner in room.polygon)
    return replace(room, id=_twin(room.id), centroid=_aside(room.centroid, aside), polygon=polygon)


def _wall_aside(wall: WallSurface, aside: float) -> WallSurface:
    plane = wall.plane and (*wall.plane[:3], wall.plane[3] - wall.plane[0] * aside)
    room, source = wall.room and _twin(wall.room), wall.source and _twin(wall.source)
    parts = tuple((_twin(body), a, b, full) for body, a, b, full in wall.parts)
    return replace(
        wall, id=_twin(wall.id), room=room, centroid=_aside(wall.centroid, aside), plane=plane, source=source,
        parts=parts,
    )  # fmt: skip


def _cover(count: int, rng: np.random.Generator) -> Array:
    """(N, 3) points on what is held before the sensor."""
    rays = rng.normal(size=(count, 3))
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True) * rng.uniform(*COVER, (count, 1)))
