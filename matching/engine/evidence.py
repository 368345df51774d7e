"""The log likelihood ratio of a map under a field of motions against chance, in nats.

Each S wall is either a wall of the plan, with a normal deviation whose size is marginalised over, or something else
(clutter, or a wall that is not in the plan); chance is an A wall of its direction at a random place. The walls of an S
room belong to one A room; the A rooms' walls and doors should be in the map; and the field pays for its deformation
between neighbours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.door_evidence import door_evidence
from matching.engine.field import Fields, Judged, Scene, chi2, judge
from matching.engine.field_loops import SIGMA_HEADING, SIGMA_SCORE

SIGMAS = np.array([0.02, 0.04, 0.07, 0.12])  # metres across, equally likely beforehand
NOT_IN_PLAN = 0.3  # prior of an S wall, over its length in metres: cupboards are short
NOT_IN_PLAN_BOUNDS = (0.04, 0.3)
LEAST_DENSITY = 0.1  # walls per metre; a rare direction must not prove a place
SEEN = 0.3  # quality of a pair
SHOWN = 0.8  # metres; shorter walls may well vanish
ENTERED = 0.6
MOST_STRAINED = 50.0  # chi^2 of one pair of neighbours: rooms are not torn from one another
LEAST_HERE, MOST_OFF = 1e-6, 0.8  # pairs that lie less beside each other, or further off (metres), are as good as none
ELSEWHERE = 0.1  # how likely a wall is that of another A room than its S room's
# How the ends of walls may have been seen, one way for all of a map, all ways equally likely beforehand: metres along;
# of the ends, those that are where the plan has them, stop short of there, and run on.
# A robot finds an end well or not at all; a map that was drawn by hand, or is old, has them all, and all a little off.
ENDS = np.array([(0.05, 0.5, 0.45, 0.05), (0.35, 0.87, 0.08, 0.05)])


@dataclass(frozen=True)
class Noise:
    """What is known of a map's noise: its `sigmas` in metres across, and rows as those of `ENDS`, all combinations of
    them equally likely.
    """

    sigmas: Array
    ends: Array


UNKNOWN = Noise(SIGMAS, ENDS)


@dataclass(frozen=True)
class Chance:
    """The storey and building whose walls define chance, the same for all fields of a scene.

    With one for each field, the place in the emptier of two equal storeys would look better.
    """

    storey: int
    building: int

    @staticmethod
    def of(scene: Scene, fields: Fields, table: Index) -> "Chance":
        """Where most walls of the first field are, weighted by what they explain."""
        quality = judge(scene, table[:1], fields.state[:1], SIGMA_SCORE).quality[0]
        storey = int(fields.storey[0])
        building = scene.plan.storeys[storey].building[np.where(table[0] >= 0, table[0] - scene.plan.first[storey], 0)]
        explained = np.bincount(building.ravel(), (quality * scene.s.half[:, None]).ravel())
        return Chance(storey, int(explained.argmax()))


@dataclass(frozen=True)
class Terms:
    """The terms (K,) of the evidence of K fields in nats, and what they follow from."""

    walls: Array
    each: Array  # (K, Ns) nats of each S wall, at the noise that explains its map best
    seen: Array  # for planned walls that the map has or lacks
    doors: Array
    bending: Array  # what the field pays
    now: Judged
    homes: Index  # (K, R)

    @property
    def total(self) -> Array:
        """(K,) the evidence."""
        return np.asarray(self.walls + self.seen + (self.doors - self.bending))


def evidence(scene: Scene, fields: Fields, table: Index, chance: Chance, noise: Noise = UNKNOWN) -> Terms:
    """Returns the evidence of fields, comparable between all fields of a scene."""
    now = judge(scene, table, fields.state, SIGMA_SCORE)
    home = homes(scene, table, now.quality)
    nats = _of_walls(scene, fields, table, now, home, chance, noise)
    total = nats.sum(axis=1)
    each = np.take_along_axis(nats, total.argmax(axis=1)[:, None, None], axis=2)[..., 0]
    walls = np.logaddexp.reduce(total, axis=1) - np.log(total.shape[1])
    seen = []
    for k, storey in enumerate(fields.storey.tolist()):
        a, is_seen = scene.plan.storeys[storey], seen_walls(scene, storey, table[k], now.quality[k])
        seen.append(_completeness(a.half, a.room, len(a.rooms), is_seen, home[k]))
    doors = door_evidence(scene, fields, home)
    return Terms(walls, each, np.array(seen), doors, 0.5 * bending(scene, fields), now, home)


def bending(scene: Scene, fields: Fields) -> Array:
    """(K,) chi^2 of a chain of rooms, from the mean over all neighbours: neighbours form loops, drift accumulates
    along a path.
    """
    if not len(scene.groups.edges):
        return np.zeros(len(fields))
    each = np.minimum(chi2(scene, fields.state), MOST_STRAINED)
    return np.asarray(each.mean(axis=1) * (len(scene.groups) - 1))


def homes(scene: Scene, table: Index, quality: Array) -> Index:
    """(K, R) the A room of the field's storey that has most walls of each S room, -1 for none."""
    rooms = max((len(a.rooms) for a in scene.plan.storeys), default=0)
    s = scene.s
    return np.asarray(_homes_of(s.room, s.weight, len(s.rooms), scene.plan.room, rooms, table, quality))


@compiled
def _homes_of(
    s_room: Index, weight: Array, s_rooms: int, a_room: Index, a_rooms: int, table: Index, quality: Array
) -> Index:
    """See `homes`; each wall votes for the room of its best partner."""
    home = np.full((len(table), s_rooms), -1)
    for k in range(len(table)):
        votes = np.zeros((s_rooms, a_rooms))
        for i in range(len(s_room)):
            p = quality[k, i].argmax()
            room = a_room[table[k, i, p]]
            if quality[k, i, p] > SEEN and s_room[i] >= 0 and room >= 0:
                votes[s_room[i], room] += weight[i] * quality[k, i, p]
        for r in range(s_rooms):
            for q in range(a_rooms):
                if votes[r, q] > (votes[r, home[k, r]] if home[k, r] >= 0 else 0.0):
                    home[k, r] = q
    return home


def _of_walls(
    scene: Scene, fields: Fields, table: Index, now: Judged, homes: Index, chance: Chance, noise: Noise
) -> Array:
    """(K, Ns, precisions) nats of the S walls."""
    s, plan = scene.s, scene.plan
    met = _met(scene, fields, chance)
    return np.asarray(_nats(
        s.half, s.known, s.room, plan.half, plan.known, plan.room, table, now.beside, now.across, now.along,
        now.turned, met, homes, noise.sigmas, noise.ends,
    ))  # fmt: skip


@compiled
def _nats(
    half: Array, known: NDArray[np.bool_], room: Index, a_half: Array, a_known: NDArray[np.bool_], a_room: Index,
    table: Index, beside: Array, across: Array, along: Array, turned: Array, met: Array, home: Index,
    sigmas: Array, ends: Array,
) -> Array:  # fmt: skip
    """(K, Ns, precisions) nats of the S walls; a room's walls are those of one A room."""
    fields, walls, width = table.shape
    precisions = len(sigmas) * len(ends)
    nats, density, best = np.empty((fields, walls, precisions)), np.empty(precisions), np.empty(precisions)
    for k in range(fields):
        for i in range(walls):
            best[:] = 0.0
            own = home[k, room[i]] if room[i] >= 0 else -1
            for p in range(width):
                here = beside[k, i, p] * np.exp((-0.5 / SIGMA_HEADING**2) * turned[k, i, p] ** 2)
                if here <= LEAST_HERE or abs(across[k, i, p]) >= MOST_OFF:
                    continue
                j = table[k, i, p]
                _measured(
                    across[k, i, p], along[k, i, p], half[i], a_half[j], known[i] and a_known[j], sigmas, ends, density
                )
                ratio = here / met[k, i] * (1.0 if own < 0 or a_room[j] < 0 or a_room[j] == own else ELSEWHERE)
                for n in range(precisions):
                    best[n] = max(best[n], ratio * density[n])
            other = min(max(NOT_IN_PLAN / (2 * half[i]), NOT_IN_PLAN_BOUNDS[0]), NOT_IN_PLAN_BOUNDS[1])
            for n in range(precisions):
                nats[k, i, n] = np.log((1 - other) * best[n] + other)
    return nats


@compiled
def _measured(
    across: float, along: float, half: float, a_half: float, known: bool, sigmas: Array, ends: Array, density: Array
) -> None:
    """Writes (precisions,) the density of a wall's offset from a line of the plan, times that of its ends if
    lengths are known.
    """
    for e in range(len(ends)):
        sigma, seen, short, beyond = ends[e]
        both = 1.0
        if known:
            for side in (-1, 1):
                gap = side * along + half - a_half
                both *= seen * _normal(gap, sigma) * max(2 * a_half, 1.0) + (short if gap < 0 else beyond)
        density[e :: len(ends)] = both
    for n in range(len(sigmas)):
        normal = _normal(across, sigmas[n])
        for e in range(len(ends)):
            density[n * len(ends) + e] *= normal


@compiled
def _normal(off: float, sigma: float) -> float:
    """Normal density; 0 beyond ten deviations, where other explanations dominate."""
    return np.exp(-0.5 * (off / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma) if abs(off) < 10 * sigma else 0.0


def _met(scene: Scene, fields: Fields, chance: Chance) -> Array:
    """(K, Ns) how many A walls of its direction an S wall meets per metre across, at a random place of the building."""
    storeys = scene.plan.storeys
    a = storeys[chance.storey]
    turned = np.array([storeys[st].T_graph_own[0] - a.T_graph_own[0] for st in fields.storey.tolist()])
    count, half = scene.plan.met[chance.storey][:, chance.building]
    yaw = np.arctan2(np.sin(fields.state[..., 0]).sum(axis=1), np.cos(fields.state[..., 0]).sum(axis=1)) + turned
    degree = np.rint(np.degrees(scene.s.heading + yaw[:, None])).astype(np.int64) % 360
    met = 2 * (half[degree] + count[degree] * scene.s.half)
    return np.asarray(np.maximum(met / a.building_areas[chance.building], LEAST_DENSITY))


def seen_walls(scene: Scene, storey: int, table: Index, quality: Array) -> NDArray[np.bool_]:
    """(walls of the storey,) whether each is a partner of an S wall; `table` and `quality` (Ns, P) are of one field."""
    seen = np.zeros(len(scene.plan.storeys[storey]), dtype=np.bool_)
    seen[table[quality > SEEN] - int(scene.plan.first[storey])] = True
    return seen


def _completeness(half: Array, a_room: Index, rooms: int, seen: NDArray[np.bool_], home: Index) -> float:
    """Nats for the A walls of one storey that the map should have: those of A rooms with most walls of some S room.

    An A room was either entered, so that most of its walls are observed, or seen through a door.
    """
    expected = (2 * half > SHOWN) & (a_room >= 0)
    of_map = np.unique(home[home >= 0])
    found = np.bincount(a_room[expected & seen], minlength=rooms)[of_map]
    missing = np.bincount(a_room[expected & ~seen], minlength=rooms)[of_map]
    entered = np.log(ENTERED) + np.log(0.85 / 0.5) * found + np.log(0.15 / 0.5) * missing
    glimpsed = np.log(1 - ENTERED) + np.log(0.4 / 0.5) * found + np.log(0.6 / 0.5) * missing
    return float(np.logaddexp(entered, glimpsed).sum())
