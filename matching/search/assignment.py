"""Assigns rooms and wall surfaces under a rigid placement."""

from dataclasses import dataclass

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from matching.engine.confidence import room_confidence, surface_confidence
from matching.search.hypotheses import Placement

LEAST_QUALITY = 0.1
PART_SHARE = 0.25  # of an S room's walls on an A room's: it may be two rooms in one
OTHER_ROOM = 0.3  # weight of a wall pair whose rooms are not matched to each other
LEAST_SHARE = 0.3  # of an S room's walls that its A room explains
INSIDE = 0.1  # of share, that an A room counts more in which the S room's centroid lies
LEAST_MERIT = 0.55  # share of the best A room, for a room to be matched: a badly segmented room belongs to two
DOUBT = 0.1  # quality of a wall of no plan


@dataclass(frozen=True)
class Pairs:
    """Matches as indices into S and A, with a confidence in [0, 1] given that the placement is right."""

    rooms: tuple[tuple[int, int, float], ...]
    surfaces: tuple[tuple[int, int, float], ...]


def assign(placement: Placement) -> Pairs:
    """Returns rooms by the walls they share, one to one (parts of a room may share one), then surfaces.

    The confidence of a surface pair follows from the share q / (q + q' + 0.1). Its quality q is
    exp(-residual^2 / 2 sigma^2) times the share of its length that overlaps the A wall; q' is that of the next best A
    wall, and 0.1 stands for a wall outside the plan. Room pairs use the shares of the S room's walls, by length, that A
    rooms explain. If two A rooms explain a room about equally well, its walls are matched but the room itself is not.
    """
    pairing = placement.pairing
    s, a = pairing.s, pairing.a
    quality = pairing.table(placement.fit.quality)
    share, size = _shares(placement, quality)
    rooms = _rooms(placement, share, size)
    at_home = np.zeros((len(s.rooms) + 1, len(a.rooms) + 1), dtype=bool)  # the last ones: walls without a room
    at_home[:-1, :-1] = share > PART_SHARE
    for r, q, _ in rooms:
        at_home[r, q] = True
    at_home[~at_home.any(axis=1)] = True
    at_home[:, -1] = True
    quality = np.where(at_home[s.room][:, a.room], quality, OTHER_ROOM * quality)
    accepted = tuple((r, q, room_confidence(c)) for r, q, c in rooms if c >= LEAST_MERIT)
    return Pairs(accepted, _surfaces(placement, quality))


def _share(value: Array, chosen: int) -> float:
    others = np.delete(value, chosen)
    return float(value[chosen] / (value[chosen] + others.max(initial=0.0) + DOUBT))


def _rooms(placement: Placement, share: Array, size: Array) -> tuple[tuple[int, int, float], ...]:
    """(S room, A room, share of the merit)."""
    from scipy.optimize import linear_sum_assignment  # slow to import

    s, a = placement.pairing.s, placement.pairing.a
    if not s.rooms or not a.rooms:
        return ()
    inside = _inside(placement)
    merit = share + np.where(inside, INSIDE, 0.0)
    one_to_one = zip(*linear_sum_assignment(-merit * size[:, None]), strict=True)
    chosen = [(r, q) for r, q in one_to_one if _accepted(share, inside, r, q)]
    taken = {r for r, _ in chosen}
    for r in range(len(s.rooms)):  # the parts of a room that the map has cut
        q = int(np.argmax(merit[r]))
        if r not in taken and inside[r, q] and share[r, q] > 2 * LEAST_SHARE:
            chosen.append((r, q))
    return tuple((int(r), int(q), _share(merit[r], q)) for r, q in sorted(chosen))


def _shares(placement: Placement, quality: Array) -> tuple[Array, Array]:
    """(S rooms, A rooms) the share of each S room's walls, by length, on the A room's; (S rooms,) lengths in metres.

    Lengths decide, since the truth for a badly segmented room is the A room that most of it belongs to.
    """
    s, a = placement.pairing.s, placement.pairing.a
    best = np.zeros((len(s), len(a.rooms)))
    for q in range(len(a.rooms)):
        best[:, q] = quality[:, a.room == q].max(axis=1)
    squared = best**2  # what lies on walls of several rooms is shared between them
    each = squared * (best.max(axis=1, initial=0.0) / np.maximum(squared.sum(axis=1), 1e-12))[:, None]
    with_room = s.room >= 0
    size = np.asarray(np.bincount(s.room[with_room], 2 * s.half[with_room], len(s.rooms)), dtype=float)
    share = np.zeros((len(s.rooms), len(a.rooms)))
    np.add.at(share, s.room[with_room], 2 * s.half[with_room, None] * each[with_room])
    return share / size[:, None], size


def _accepted(share: Array, inside: Array, r: int, q: int) -> bool:
    return bool(share[r, q] > LEAST_SHARE * (0.6 if inside[r, q] else 1.0))


def _inside(placement: Placement) -> Array:
    """(S rooms, A rooms) whether the S room's centroid lies in the A room's footprint."""
    import shapely  # slow to import

    pairing = placement.pairing
    s, a = pairing.s, pairing.a
    motions = pairing.motions(placement.state)[0]
    group = np.array([pairing.group[np.nonzero(s.room == r)[0][0]] for r in range(len(s.rooms))])
    own = se2.apply(se2.inverse(s.T_graph_own), np.array([r.centroid for r in s.rooms]))
    placed = se2.apply(a.T_graph_own, se2.apply(motions[group], own))
    inside = np.zeros((len(s.rooms), len(a.rooms)), dtype=bool)
    for q, room in enumerate(a.rooms):
        if room.polygon is not None and len(room.polygon) > 2:
            inside[:, q] = shapely.contains_xy(shapely.Polygon(room.polygon), placed[:, 0], placed[:, 1])
    return inside


def _surfaces(placement: Placement, quality: Array) -> tuple[tuple[int, int, float], ...]:
    from scipy.optimize import linear_sum_assignment

    s = placement.pairing.s
    chosen = [
        (int(i), int(j)) for i, j in zip(*linear_sum_assignment(-quality), strict=True) if quality[i, j] > LEAST_QUALITY
    ]
    along = placement.pairing.table(placement.fit.along)
    span = np.stack((along - s.half[:, None], along + s.half[:, None]), axis=-1)
    matched = dict(chosen)
    for i in np.argsort(-s.half, kind="stable"):  # further pieces of a wall, where they lie beside its others
        if int(i) in matched:
            continue
        j = int(np.argmax(quality[i]))
        others = [span[k, j] for k, q in matched.items() if q == j]
        common = max((min(span[i, j, 1], o[1]) - max(span[i, j, 0], o[0]) for o in others), default=0.0)
        if quality[i, j] > LEAST_QUALITY and common < 0.5 * 2 * s.half[i]:
            matched[int(i)] = j
    return tuple((i, j, surface_confidence(_share(quality[i], j))) for i, j in sorted(matched.items()))
