"""What makes a run hard, in three lists: of the building and its plan, of the sensor, and of the recording."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan
from data.scene_graph import LevelSurface, Room, SceneGraph, WallSurface, Xy
from data.simulation import Changes
from data.trajectory import Trajectory

Array = NDArray[np.float64]

# Of the building: how it differs from its plan. 97 mm is no multiple of the steps in which displacements are searched.
BUILDING: dict[str, Changes] = {
    "15 mm": Changes(moved=0.2, moved_by=0.015, openings_displaced=0.2, columns_displaced=0.3, displaced_by=0.097),
    "30 mm": Changes(moved=0.2, moved_by=0.03, openings_filled=0.2, columns_absent=0.3),
    "10 to 30 cm": Changes(moved=0.33),
    "absent": Changes(absent=0.1, unplanned=0.1),
}
# Of the plan that is given: of another building, of two equal ones side by side, with another storey stated, without
# half of its walls; with all ceilings a few centimetres too low, with each floor and ceiling off by chance, without
# what hangs or is raised.
PLACES = ("foreign plan", "doubled plan", "wrong storey", "half the walls")
PLANS = (*PLACES, "low ceilings", "levels off", "flat plan")
# Of the sensor, with the amounts of four severities; "mirrored" and "feet" have none.
SENSOR: dict[str, tuple[float, ...]] = {
    "dropout": (0.3, 0.6, 0.8, 0.95),  # of the returns are lost, at random
    "field of view": (270.0, 180.0, 120.0, 70.0),  # degrees that remain of the horizontal one
    "noise": (0.02, 0.05, 0.1, 0.2),  # m, standard deviation of each range
    "sparsity": (0.75, 0.5, 0.25, 0.125),  # of the beams remain
    "vibration": (0.2, 0.5, 1.0, 2.0),  # degrees of amplitude
    "mirrored": (),  # y of every point is negated
    "feet": (),  # lengths are in feet, and taken as metres
}
# Of the recording; those without amounts begin after 40 % of the drive.
RECORDING: dict[str, tuple[float, ...]] = {
    "occlusion": (0.15, 0.3, 0.5, 0.7),  # of the directions are blocked by things near the sensor
    "people": (2.0, 5.0, 10.0, 20.0),  # walk round the sensor
    "gaps": (1.0, 2.0, 4.0, 8.0),  # of 2 s without a scan
    "sliding doors": (),  # close behind and before the sensor, and are walls in the plan
    "covered": (),  # for 5 s a cap is over the sensor, while it is carried on
    "kidnapped": (),  # no scans for 12 s while the sensor is carried on; the stamps show no gap
    "shaken": (),  # the sensor is turned to and fro, at up to 300 degrees/s; part of the simulation
}
NO_PLACE = ("mirrored", "feet", "foreign plan", "doubled plan")  # no place in the plan is right, or none is best

BEGINS = 0.4  # of the drive
COVERED_S, CARRIED_S = 5.0, 12.0
COVER_M = 0.15, 0.25  # from the sensor: a hand or a cap
FEET = 1 / 0.3048
BESIDE_M = 5.0  # between two equal buildings
LOW_M = 0.03  # of the planned ceilings
OFF_M = 0.01, 0.03  # standard deviations of planned floors and ceilings, each those of a storey together
BEAM_RAD = float(np.radians(2.0))  # one beam of 16
BLOCKS, BLOCK_S, BLOCK_M = 12, 2.0, (0.4, 0.8)  # directions that are blocked together, for how long, how near
PERSON_RADIUS_M, PERSON_RANGE_M = 0.25, (0.8, 4.0)
PERSON_BELOW_M, PERSON_ABOVE_M = 1.4, 0.4  # of a sensor that is carried in a hand
PERSON_SPEED, VIBRATION_HZ = 0.8, 12.0  # m/s
OPENS_M, SEEN_M = 1.5, 12.0  # from a sliding door to the sensor, when it opens; from which on it matters
DOOR_M, AT_DOOR_M = 0.9, 0.6  # width of a door where unknown; to its wall
GAP_S, FIRST_GAP_S = 2.0, 5.0


def split(trouble: str) -> tuple[str, int]:
    """The name of a trouble and its severity, 0 for those without. Raises UserError for an unknown one."""
    name, _, number = trouble.rpartition(" ")
    if trouble in (*PLANS, *SENSOR, *RECORDING) and not {**SENSOR, **RECORDING}.get(trouble):
        return trouble, 0
    amounts = {**SENSOR, **RECORDING}.get(name, ())
    if number.isdecimal() and 1 <= int(number) <= len(amounts):
        return name, int(number)
    known = ", ".join((*PLANS, *(f"{key} 1-4" if own else key for key, own in {**SENSOR, **RECORDING}.items())))
    raise UserError(f"trouble '{trouble}': not known; use {known}")


class Recorded(Protocol):
    """A drive of `count` scans, one each `period_s` seconds; `truth` is T_bim_sensor."""

    @property
    def truth(self) -> Trajectory:
        """The true poses."""

    @property
    def count(self) -> int:
        """The number of scans."""

    @property
    def period_s(self) -> float:
        """Seconds from scan to scan."""

    def scans(self, count: int | None = None, times: bool = True) -> Iterator[Scan]:
        """The scans, or the first `count`."""


@dataclass(frozen=True, eq=False)
class Troubled:
    """The scans of a drive as a run gets them, the same at each reading, and the true T_bim_sensor at their stamps."""

    drive: Recorded
    trouble: str = ""
    times: bool = True
    leaves: tuple[WallSurface, ...] = ()  # of sliding doors

    @property
    def truth(self) -> Trajectory:
        """At the stamps of `scans`, and at some after them."""
        truth, (begin, gap) = self.drive.truth, self._gap_ns
        before, after = truth.stamps_ns < begin, truth.stamps_ns >= begin + gap
        stamps = np.concatenate([truth.stamps_ns[before], truth.stamps_ns[after] - gap])
        poses = np.concatenate([truth.poses[before], truth.poses[after]])
        return Trajectory(stamps, poses)

    @property
    def _gap_ns(self) -> tuple[int, int]:
        """From when, and for how long, no scan comes as the sensor is carried elsewhere."""
        begin = round(1e9 * BEGINS * self.drive.count * self.drive.period_s)
        return begin, round(1e9 * CARRIED_S) if self.trouble == "kidnapped" else 0

    def scans(self, count: int | None = None) -> Iterator[Scan]:
        """The scans, or those of the first `count`; after a gap the stamps go on as if there were none."""
        name, severity = split(self.trouble) if self.trouble else ("", 0)
        change, (begin, gap) = CHANGES.get(name), self._gap_ns
        number = list(CHANGES).index(name) if change else 0
        for scan in self.drive.scans(count, self.times):
            if 0 <= scan.stamp_ns - begin < gap or (name == "gaps" and self._in_gap(scan.stamp_ns, severity)):
                continue
            sent = replace(scan, stamp_ns=scan.stamp_ns - gap * (scan.stamp_ns >= begin))
            amount = {**SENSOR, **RECORDING}[name][severity - 1] if severity else 0.0
            yield sent if change is None else change(sent, amount, self, (number, severity))

    def rng(self, *of: int) -> np.random.Generator:
        """Random numbers that are the same at each reading."""
        return np.random.default_rng(of)

    def since_begin_s(self, scan: Scan) -> float:
        """Seconds from when the trouble begins to a scan."""
        return (scan.stamp_ns - self._gap_ns[0]) / 1e9

    def _in_gap(self, stamp_ns: int, severity: int) -> bool:
        """The gaps lie evenly from `FIRST_GAP_S` on."""
        end_s = self.drive.count * self.drive.period_s
        late = stamp_ns / 1e9 - FIRST_GAP_S
        return late >= 0 and late % ((end_s - FIRST_GAP_S) / RECORDING["gaps"][severity - 1]) < GAP_S


Change = Callable[[Scan, float, Troubled, tuple[int, int]], Scan]


def _kept(scan: Scan, keep: NDArray[np.bool_]) -> Scan:
    """The points of a scan that remain; the first one if none would."""
    keep = keep if keep.any() else np.arange(len(keep)) == 0
    times = None if scan.point_times is None else scan.point_times[keep]
    return replace(scan, points=np.ascontiguousarray(scan.points[keep]), point_times=times)


def _dropout(scan: Scan, share: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    return _kept(scan, of.rng(*seed, scan.index).random(len(scan.points)) >= share)


def _field_of_view(scan: Scan, degrees: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    return _kept(scan, np.abs(_azimuth(scan.points)) <= np.radians(degrees) / 2)


def _noise(scan: Scan, sigma: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    ranges = np.linalg.norm(scan.points, axis=1)
    noisy = np.maximum(ranges + of.rng(*seed, scan.index).normal(0.0, sigma, len(ranges)), 0.0)
    return replace(scan, points=scan.points * (noisy / ranges)[:, None])


def _sparsity(scan: Scan, share: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    elevation = np.arctan2(scan.points[:, 2], np.linalg.norm(scan.points[:, :2], axis=1))
    beam = np.round((elevation + np.pi / 2) / BEAM_RAD)
    return _kept(scan, np.floor((beam + 1) * share) > np.floor(beam * share))


def _vibration(scan: Scan, degrees: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    """The sensor turns to and fro about its x and y axes as it measures."""
    phase = 2 * np.pi * VIBRATION_HZ * (scan.stamp_ns + _times_ns(scan)) / 1e9
    turn = np.radians(degrees) * np.column_stack([np.sin(phase), np.sin(0.83 * phase + 1.0), np.zeros(len(phase))])
    return replace(scan, points=scan.points - np.cross(turn, scan.points))


def _mirrored(scan: Scan, amount: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    return replace(scan, points=scan.points * [1.0, -1.0, 1.0])


def _feet(scan: Scan, amount: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    return replace(scan, points=scan.points * FEET)


def _occlusion(scan: Scan, share: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    """Screens stand near the sensor; after `BLOCK_S` they stand in other directions."""
    rng = of.rng(*seed, int(scan.stamp_ns / 1e9 / BLOCK_S))
    blocked = rng.permutation(BLOCKS) < round(share * BLOCKS)
    near = rng.uniform(*BLOCK_M, BLOCKS)
    block = ((_azimuth(scan.points) + np.pi) / (2 * np.pi) * BLOCKS).astype(int) % BLOCKS
    ranges = np.linalg.norm(scan.points, axis=1)
    shown = np.where(blocked[block], np.minimum(near[block], ranges), ranges)
    return replace(scan, points=scan.points * (shown / ranges)[:, None])


def _people(scan: Scan, count: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    """People walk in circles round the sensor; those behind a wall hide nothing."""
    rng = of.rng(*seed)
    circle = rng.uniform(*PERSON_RANGE_M, int(count))
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


def _sliding_doors(scan: Scan, amount: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    """Each door is closed while the sensor is not near it."""
    T_bim_sensor = of.drive.truth.at(scan.stamp_ns + _times_ns(scan))
    rays = np.einsum("nij,nj->ni", T_bim_sensor[:, :3, :3], scan.points)[:, :2]
    begin, shown = T_bim_sensor[:, :2, 3], np.ones(len(rays))
    for leaf in of.leaves:
        centre, normal = np.array(leaf.centroid), np.array(leaf.normal)
        if not OPENS_M < np.hypot(*(begin[0] - centre)) < SEEN_M:
            continue
        along = rays @ normal
        met = (centre - begin) @ normal / np.where(np.abs(along) > 1e-9, along, np.inf)
        aside = np.abs((begin + met[:, None] * rays - centre) @ np.array([-normal[1], normal[0]]))
        hit = (met > 0) & (met < 1) & (aside < (leaf.length or DOOR_M) / 2)
        shown = np.where(hit, np.minimum(shown, met), shown)
    return replace(scan, points=scan.points * shown[:, None])


def _covered(scan: Scan, amount: float, of: Troubled, seed: tuple[int, int]) -> Scan:
    if not 0 <= of.since_begin_s(scan) < COVERED_S:
        return scan
    rng = of.rng(*seed, scan.index)
    rays = rng.normal(size=(len(scan.points), 3))
    near = rng.uniform(*COVER_M, (len(rays), 1))
    return replace(scan, points=rays / np.linalg.norm(rays, axis=1, keepdims=True) * near)


CHANGES: dict[str, Change] = {
    "dropout": _dropout,
    "field of view": _field_of_view,
    "noise": _noise,
    "sparsity": _sparsity,
    "vibration": _vibration,
    "mirrored": _mirrored,
    "feet": _feet,
    "occlusion": _occlusion,
    "people": _people,
    "covered": _covered,
    "sliding doors": _sliding_doors,
}


def doubled(plan: SceneGraph) -> SceneGraph:
    """The plan of two equal buildings side by side: every place in one is as good as that in the other."""
    places = np.array([corner for room in plan.rooms for corner in room.polygon or (room.centroid,)])
    aside = float(np.ptp(places[:, 0])) + BESIDE_M

    def name(of: str) -> str:
        return f"{of}, beside"

    def moved(place: Xy) -> Xy:
        return place[0] + aside, place[1]

    def room_beside(room: Room) -> Room:
        polygon = None if room.polygon is None else tuple(map(moved, room.polygon))
        return replace(room, id=name(room.id), centroid=moved(room.centroid), polygon=polygon)

    def wall_beside(wall: WallSurface) -> WallSurface:
        plane = wall.plane and (*wall.plane[:3], wall.plane[3] - wall.plane[0] * aside)
        room, source = wall.room and name(wall.room), wall.source and name(wall.source)
        parts = tuple((name(body), a, b, full) for body, a, b, full in wall.parts)
        centroid = moved(wall.centroid)
        return replace(wall, id=name(wall.id), room=room, centroid=centroid, plane=plane, source=source, parts=parts)

    doors = tuple(
        replace(door, id=name(door.id), rooms=tuple(map(name, door.rooms)), centroid=moved(door.centroid))
        for door in plan.doors
    )
    return replace(
        plan,
        rooms=plan.rooms + tuple(map(room_beside, plan.rooms)),
        wall_surfaces=plan.wall_surfaces + tuple(map(wall_beside, plan.wall_surfaces)),
        doors=plan.doors + doors,
    )


def without_half_of_its_walls(plan: SceneGraph, seed: int) -> SceneGraph:
    """The plan without every second wall surface, by chance."""
    kept = np.random.default_rng([seed, 67]).random(len(plan.wall_surfaces)) < 0.5
    return replace(plan, wall_surfaces=tuple(w for w, keep in zip(plan.wall_surfaces, kept, strict=True) if keep))


def leaves_of(plan: SceneGraph) -> tuple[WallSurface, ...]:
    """The closed doors of a plan, as wall surfaces: one for each side, in line with the wall there."""
    leaves = []
    for door in plan.doors:
        for room in door.rooms:
            beside = [w for w in plan.surfaces_of_room.get(room, ()) if _off(w, door.centroid) < AT_DOOR_M]
            if not beside:
                continue
            wall = min(beside, key=lambda w: _off(w, door.centroid))
            across = float(np.subtract(door.centroid, wall.centroid) @ np.array(wall.normal))
            x, y = (np.array(door.centroid) - across * np.array(wall.normal)).tolist()
            width = door.width or DOOR_M
            leaves.append(replace(wall, id=f"{door.id}, {room}", centroid=(x, y), length=width, parts=()))
    return tuple(leaves)


def _off(wall: WallSurface, place: Xy) -> float:
    """How far (m) a place is from a wall."""
    return float(shapely.distance(shapely.LineString(wall.ends()), shapely.Point(place)))


def with_doors_as_walls(plan: SceneGraph) -> SceneGraph:
    """The plan in which all doors are walls."""
    return replace(plan, wall_surfaces=plan.wall_surfaces + leaves_of(plan), doors=())


def with_levels_raised(plan: SceneGraph, floors: float, ceilings: float) -> SceneGraph:
    """The plan with all floors and all ceilings so much (m) higher."""

    def raised(surface: LevelSurface) -> LevelSurface:
        nx, ny, nz, d = surface.plane
        return replace(surface, plane=(nx, ny, nz, d - nz * (floors if surface.is_floor else ceilings)))

    return replace(plan, level_surfaces=tuple(map(raised, plan.level_surfaces)))


def with_levels_off(plan: SceneGraph, seed: int) -> SceneGraph:
    """The plan with its floors off by chance, and its ceilings."""
    floors, ceilings = np.random.default_rng([seed, 57]).normal(0.0, OFF_M).tolist()
    return with_levels_raised(plan, floors, ceilings)


def _azimuth(points: Array) -> Array:
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]))


def _times_ns(scan: Scan) -> NDArray[np.int64]:
    """When each point was measured, after the stamp."""
    if scan.point_times is None:
        return np.zeros(len(scan.points), np.int64)
    return np.asarray(np.round(1e9 * scan.point_times), np.int64)
