"""Finds a plan's symmetries: other places that explain an S-graph about as well as its true one.

No matcher can be blamed for leaving such a pair ambiguous. The true A surfaces of the S-graph are placed elsewhere in
the A-graph: rotated, in another row of offices, on another storey. The S-graph's own noise is left out; only its extent
counts (a wall whose end was not observed is clipped there). Another place is a symmetry if an ideal observer expects
less than ln(199) = 5.3 nats of evidence for the truth over it. Such an observer knows the noise of maps: walls are
off by 0.061 m across and by 0.346 m at each end, one wall in ten is missing (`data.synthetic_maps.wall_noise`), and
deformed maps drift by 0.15 m and 1.5 degrees from room to room (`data.synthetic_maps.noise_models`; also assumed for
`heavy_drift`). The observed evidence scatters about the expected one with twice the latter as its variance. At 5.3 nats
the observer is less than 99.5 % sure of the truth in every second map; below one nat he is hardly ever sure.

The expected evidence between two Gaussian hypotheses that differ by d_k in the measurements k is
sum d_k^2 / (2 sigma_k^2). It is minimised over the motion of the map and, where the map is deformed, of its rooms with
the drift as prior (which equals marginalising the drift). A wall of the map where the plan has none costs 7 nats
(2 if shorter than 0.8 m, 14 if longer than any clutter); a missing door, whose place is known to 0.1 m, costs 3. Walls
and doors of the entered rooms that are not in the map count for or against the place. Directions have a sigma of
1 degree and must agree within 3, since plans are not drawn, and walls not built, as precisely as a LiDAR measures.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from data import SceneGraph
from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import DrawnGraph
from data.synthetic_maps.wall_noise import MISSING, SHORTEST, SIGMA_END
from matching.ambiguity.perfect_map import visible_walls
from matching.ambiguity.symmetry_doors import doors_at_home, doors_there, observed_doors
from matching.ambiguity.symmetry_evidence import PlacedPart, part_of, place_part
from matching.arrays import Index, Walls, arrays, storeys
from matching.engine.votes import candidates
from matching.search.hypotheses import DISTINCT_M, DISTINCT_RAD, between_graphs
from matching.search.scoring import explained

SURE = float(np.log(199))  # nats
EQUAL = 1.0  # nats to be expected: in fewer than one map of a thousand of such a place it comes to SURE
ENTERED = 0.5  # of a room's walls, by length, are in the map
SIGMA_SEARCH = 0.35  # metres
HOPEFUL = 0.7  # of the weight of what was seen is explained by a rigid motion,
FEW, HOPEFUL_OF_FEW = 16, 0.5  # and of its longest walls
MOST = 20  # places that are worked out on each storey


@dataclass(frozen=True)
class Symmetry:
    """Another place that explains the map.

    `T_a_s` is (yaw, x, y) in rad and m, `floor` the A floor's id, `nats` the expected evidence for the truth over it.
    """

    T_a_s: tuple[float, float, float]
    floor: str | None
    nats: float


def symmetries(drawn: DrawnGraph, a: SceneGraph) -> list[Symmetry]:
    """Returns the symmetries of a map's true place, those hardest to tell from it first.

    They are distinct in the same sense as the hypotheses of a match. Raises KeyError if the true matches refer to
    something that is not in the A-graph.
    """
    seen = visible_walls(drawn, a)
    if not seen.surfaces:
        return []
    part = part_of(arrays(a, drawn.floor, list(seen.surfaces)), seen.goes_on, drawn.deformed)
    floors = storeys(a)
    home = next(s for s in floors if part.walls.ids[0] in s.ids)
    index = {key: n for n, key in enumerate(home.ids)}
    at_home = np.array([index[key] for key in part.walls.ids])
    entered = _entered(home, at_home, part.walls.half)
    entered_rooms = np.unique(entered[entered >= 0])
    doors, own = (
        observed_doors(drawn, a, part),
        set(drawn.rooms.values()),
    )  # of rooms that were merged no doors are known
    apart = entered_rooms[[home.rooms[r].id in own for r in entered_rooms]]
    truth = _completeness(home, entered_rooms, at_home) + doors_at_home(doors, part, a, home, apart)
    found = []
    for storey in floors:
        for placed_part in place_part(part, storey, np.reshape(_elsewhere(part.walls, storey, home), (-1, 3))):
            nats = placed_part.nats + truth
            if nats >= SURE:  # all that follows only lowers the place's odds
                continue
            rooms = _rooms(placed_part, entered, storey)
            nats += doors_there(doors, part, placed_part, a, storey, rooms) - _completeness(
                storey, rooms, placed_part.partner
            )
            T_a_a = between_graphs(part.walls, storey, placed_part.motion(part))
            yaw, x, y = se2.compose(T_a_a, np.array(drawn.T_a_s)).tolist()
            found.append(Symmetry((yaw, x, y), storey.floor, nats))
    return _distinct(sorted(found, key=lambda symmetry: symmetry.nats), drawn)


def _elsewhere(seen: Walls, storey: Walls, home: Walls) -> list[Array]:
    """Motions between own frames that roughly align most walls, best first; none near the true one."""
    rough: list[tuple[float, Array]] = []
    few = _longest(seen, FEW)
    for voted in candidates(seen, storey):
        motions = voted.motions
        for walls, share in ((few, HOPEFUL_OF_FEW), (seen, HOPEFUL)):
            worth = explained(walls, storey, voted.yaw, motions, SIGMA_SEARCH) / walls.weight.sum()
            motions, worth = motions[worth >= share], worth[worth >= share]
            if not len(motions):
                break
        rough += zip(worth.tolist(), motions, strict=True)
    taken = [se2.compose(se2.inverse(storey.T_graph_own), seen.T_graph_own)] if storey is home else []
    given = len(taken)
    for _, motion in sorted(rough, key=lambda r: -r[0]):
        if len(taken) == given + MOST:
            break
        if all(_apart(motion, other) for other in taken):
            taken.append(motion)
    return taken[given:]


def _longest(walls: Walls, most: int) -> Walls:
    """The longest walls, to try many places with."""
    chosen = np.argsort(-walls.half, kind="stable")[:most]
    return replace(
        walls, ids=tuple(walls.ids[n] for n in chosen), centre=walls.centre[chosen], heading=walls.heading[chosen],
        half=walls.half[chosen], known=walls.known[chosen], room=walls.room[chosen],
    )  # fmt: skip


def _apart(motion: Array, other: Array) -> bool:
    """Whether two motions differ at the origin of the frame that they move."""
    off, turned = np.hypot(*(motion - other)[1:]), abs(se2.wrap(motion[:1] - other[:1])[0])
    return bool(off > DISTINCT_M or turned > DISTINCT_RAD)


def _distinct(found: list[Symmetry], drawn: DrawnGraph) -> list[Symmetry]:
    """Symmetries below the limit that differ, at the S-graph's centroid, from the truth and from each other."""
    middle = drawn.s_graph.centroid()

    def at(T_a_s: tuple[float, float, float]) -> Array:
        return np.array([T_a_s[0], *se2.apply(np.array(T_a_s), middle)])

    kept: list[tuple[str | None, Array]] = [(drawn.floor, at(drawn.T_a_s))]
    distinct = []
    for symmetry in found:
        new = symmetry.floor, at(symmetry.T_a_s)
        if symmetry.nats < SURE and all(new[0] != floor or _apart(new[1], place) for floor, place in kept):
            kept.append(new)
            distinct.append(symmetry)
    return distinct


def _entered(home: Walls, seen: Index, half: Array) -> Index:
    """(N,) the room of each observed wall, -1 if the map lacks most of the room's walls (by length)."""
    with_room = home.room >= 0
    size = np.bincount(home.room[with_room], home.half[with_room], len(home.rooms) + 1)
    rooms = home.room[seen]
    share = np.bincount(rooms[rooms >= 0], half[rooms >= 0], len(size)) / np.maximum(size, 1e-9)
    return np.where((rooms >= 0) & (share[rooms] >= ENTERED), rooms, -1)


def _rooms(placed_part: PlacedPart, entered: Index, storey: Walls) -> Index:
    """The rooms in which most of the walls of each entered room come to lie."""
    on = (placed_part.partner >= 0) & (entered >= 0)
    there = storey.room[placed_part.partner]
    on &= there >= 0
    pairs, count = np.unique(np.column_stack((entered[on], there[on])), axis=0, return_counts=True)
    order = np.lexsort((-count, pairs[:, 0]))
    first = np.unique(pairs[order, 0], return_index=True)[1]
    return np.unique(pairs[order][first, 1])


def _completeness(storey: Walls, rooms: Index, seen: Index) -> float:
    """Nats for which of the rooms' walls are in the map: some are missed, short ones are seldom seen."""
    walls = np.flatnonzero(np.isin(storey.room, rooms))
    vanish = np.where(storey.known[walls], ndtr((SHORTEST - 2 * storey.half[walls]) / (np.sqrt(2) * SIGMA_END)), 0.0)
    missing = MISSING + (1 - MISSING) * vanish
    return float(np.log(np.where(np.isin(walls, seen), 1 - missing, missing)).sum())
