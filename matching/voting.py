"""Wall corners vote for the motion that lays one storey's walls on another's (generalised Hough transform).

A corner is two walls that meet: their crossing, the direction between their normals, the angle between them
and which way they extend. A pair of like corners determines a proper SE(2) motion. Votes are gathered yaw
first, then in the plane, after D. H. Ballard, "Generalizing the Hough transform to detect arbitrary shapes",
Pattern Recognition 13 (1981).
"""

from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.se2 import Array
from matching.walls import Index, Walls, crossings

REACH = 1.0  # metres from a wall's end to the crossing
OPENING = np.radians(12)  # like corners differ by less
YAW_BIN = np.radians(2)
YAW_MODES = 16
PLACE_BIN = 0.3  # metres
FEW_CORNERS = 4


@dataclass(frozen=True)
class Marks:
    """What votes: (M, 2) points, (M,) headings, openings and kinds. Marks of different kinds never match."""

    point: Array
    heading: Array
    opening: Array
    kind: Index

    def __len__(self) -> int:
        return len(self.point)

    def __getitem__(self, chosen: slice) -> "Marks":
        return Marks(self.point[chosen], self.heading[chosen], self.opening[chosen], self.kind[chosen])


@dataclass(frozen=True)
class Candidates:
    """(K, 3) motions T_a_s between own frames that share one yaw mode, best voted first."""

    yaw: float
    motions: Array


def candidates(s: Walls, a: Walls) -> list[Candidates]:
    """Motions that lay S's corners on A's, by yaw modes; empty where nothing is alike."""
    s_marks, a_marks = marks(s), marks(a)
    if len(s_marks.point) < FEW_CORNERS or not len(a_marks.point):
        s_marks, a_marks = marks(s, scarce=True), marks(a, scarce=True)
    # Small maps are cheap to try, and their true place stands out less.
    return vote(s_marks, a_marks, int(np.clip(1600 / len(s), 15, 150)))


def marks(walls: Walls, scarce: bool = False) -> Marks:
    """The corners of a storey; where they are `scarce` also distant crossings and the ends of walls."""
    along, turn = crossings(walls.centre, walls.heading)
    gap = np.abs(np.abs(along) - walls.half[:, None])
    one_room = walls.room[:, None] == walls.room[None, :]
    unknown = (walls.room < 0)[:, None] | (walls.room < 0)[None, :]
    near = (gap < (8 * REACH if scarce else REACH)) & (one_room | unknown)
    i, j = np.nonzero(near & near.T & (turn > 0))  # ordered, so that a corner has one heading
    point = walls.centre[i] + along[i, j, None] * walls.tangent[i]
    # Which way the two walls extend from the crossing tells a room's corner from a pillar's.
    kind = 2 * (along[i, j] > 0) + (along[j, i] > 0)
    corners = Marks(point, walls.heading[i] + turn[i, j] / 2, turn[i, j], kind.astype(np.int64))
    return _with_ends(corners, walls) if scarce else corners


def _with_ends(corners: Marks, walls: Walls) -> Marks:
    arm = walls.half[:, None] * walls.tangent
    n = len(walls)
    return Marks(
        np.concatenate((corners.point, walls.centre + arm, walls.centre - arm)),
        np.concatenate((corners.heading, walls.heading, walls.heading)),
        np.concatenate((corners.opening, np.zeros(2 * n))),
        np.concatenate((corners.kind, np.full(n, 4), np.full(n, 5))),
    )


def vote(s: Marks, a: Marks, most: int) -> list[Candidates]:
    """Candidate motions from S to A, at most `most` for each yaw mode; empty where nothing is alike."""
    like = (s.kind[:, None] == a.kind[None, :]) & (np.abs(s.opening[:, None] - a.opening[None, :]) < OPENING)
    i, j = np.nonzero(like)
    if not len(i):
        return []
    yaw = se2.wrap(a.heading[j] - s.heading[i])
    found = []
    for mode in _yaw_modes(yaw):
        near = np.abs(se2.wrap(yaw - mode)) < 3 * YAW_BIN
        turned = se2.rotate(mode, s.point[i[near]])
        places = _places(a.point[j[near]] - turned, most)
        found.append(Candidates(mode, np.column_stack((np.full(len(places), mode), places))))
    return found


def _yaw_modes(yaw: Array) -> list[float]:
    bins = round(2 * np.pi / YAW_BIN)
    at = np.floor((yaw + np.pi) / YAW_BIN).astype(np.int64) % bins
    count = np.bincount(at, minlength=bins).astype(float)
    smooth = sum(np.roll(count, k) * (3 - abs(k)) for k in range(-2, 3))
    assert isinstance(smooth, np.ndarray)
    modes: list[float] = []
    for peak in np.argsort(-smooth, kind="stable"):
        if smooth[peak] < 0.1 * smooth.max() or len(modes) == YAW_MODES:
            break
        angle = -np.pi + (peak + 0.5) * YAW_BIN
        if all(abs(se2.wrap(np.array(angle - m))) > 4 * YAW_BIN for m in modes):
            near = se2.wrap(yaw - angle)
            modes.append(float(angle + np.mean(near[np.abs(near) < 2.5 * YAW_BIN])))
    return modes


def _places(votes: Array, most: int) -> Array:
    """(K, 2) places where votes (V, 2) gather, most first: means over 3 x 3 bins around local maxima.

    The bins are sparse: plans may lie kilometres apart.
    """
    cell = np.floor(votes / PLACE_BIN).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    stride = int(cell[:, 1].max()) + 2
    keys, inverse = np.unique(cell[:, 0] * stride + cell[:, 1], return_inverse=True)
    own = np.stack([np.bincount(inverse, w) for w in (np.ones(len(votes)), votes[:, 0], votes[:, 1])])
    total = own.copy()
    neighbours = []
    for shift in (-stride - 1, -stride, -stride + 1, -1, 1, stride - 1, stride, stride + 1):
        at = np.minimum(np.searchsorted(keys, keys + shift), len(keys) - 1)
        neighbours.append((at, keys[at] == keys + shift))
        total += np.where(neighbours[-1][1], own[:, at], 0.0)
    most_beside = np.max([np.where(real, total[0, at], 0.0) for at, real in neighbours], axis=0)
    peak = np.nonzero(total[0] >= most_beside)[0]
    best = peak[np.argsort(-total[0, peak], kind="stable")[:most]]
    return np.asarray((total[1:, best] / total[0, best]).T)
