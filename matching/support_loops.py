"""`consensus.support` as a compiled loop, for graphs that are on the CPU."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data.compiled import compiled
from matching.encoder import GraphTensors
from matching.features import Array32
from matching.relations import COMPARED_SIZE, LEAST_COS, LEFT_M, OFFSET_M, SCALES_M
from matching.walls import Index

OFFSETS = 6  # of those that are looked at in all scales: all that are left, and those across as they are
COLUMNS = COMPARED_SIZE - OFFSETS * len(SCALES_M)


def combined(
    s: GraphTensors, a: GraphTensors, candidate: Tensor, near: Tensor, first: int, last: int
) -> tuple[Tensor, Tensor, Tensor]:
    """The combinations of some S walls, `candidate` (N, K) and `near` (N, J) being rows of walls, -1 for none."""
    of_s, of_a = (
        (g.pose[g.wall_node].numpy(), g.half[g.wall_node].numpy(), g.home[g.wall_node].numpy()) for g in (s, a)
    )
    floor = a.floor[a.wall_node].numpy()
    pair, other, offsets, columns = _combinations(
        candidate.numpy(), near.numpy(), first, last, *of_s, *of_a, floor, _turned(candidate.numpy(), of_s[0], of_a[0])
    )
    apart, rest = torch.from_numpy(offsets)[:, None], torch.from_numpy(columns)
    near = torch.exp(-((apart / torch.tensor(SCALES_M)[:, None]) ** 2)).flatten(0, 1)
    rest[0] = 10 * rest[0] / (2 + 2 * rest[1]).sqrt()  # ten times the sine of half the angle
    rest[1] = rest[2].abs()
    rest[2] = rest[2] < -0.9
    rest[4] = rest[3] / 8
    rest[3] = torch.exp(-rest[3] / 2)
    return torch.from_numpy(pair), torch.from_numpy(other), torch.cat((near, rest)).T


@compiled
def _turned(candidate: Index, pose_s: Array32, pose_a: Array32) -> Array32:
    """(N, K, 2) cosine and sine of the angle from each wall to its candidates; zero where there is none."""
    found = np.zeros((*candidate.shape, 2), dtype=np.float32)
    for i in range(candidate.shape[0]):
        for t in range(candidate.shape[1]):
            if candidate[i, t] >= 0:
                c, s, u, v = pose_s[i, 2], pose_s[i, 3], pose_a[candidate[i, t], 2], pose_a[candidate[i, t], 3]
                found[i, t, 0], found[i, t, 1] = c * u + s * v, c * v - s * u
    return found


@compiled
def _combinations(
    candidate: Index, near: Index, first: int, last: int, pose_s: Array32, half_s: Array32, home_s: Index,
    pose_a: Array32, half_a: Array32, home_a: Index, floor: Index, turned: Array32,
) -> tuple[Index, Index, Array32, Array32]:  # fmt: skip
    """The two pairs of each combination, (OFFSETS, E) by how much offsets differ, and (COLUMNS, E) what `combined`
    makes the other features of; see `relations`."""
    width, most = candidate.shape[1], (last - first) * near.shape[1] * candidate.shape[1] ** 2
    pair, other = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    offsets, columns = np.empty((most, OFFSETS), dtype=np.float32), np.empty((most, COLUMNS), dtype=np.float32)
    count, least_cos, offset = 0, np.float32(LEAST_COS), np.float32(OFFSET_M)
    for i in range(first, last):
        for t in range(width):
            p = candidate[i, t]
            for n in range(near.shape[1] if p >= 0 else 0):
                j = near[i, n]
                if j < 0:
                    continue
                in_s = _related(pose_s[i], pose_s[j])
                far = np.hypot(in_s[0], in_s[1])
                low, high = max(far - offset, np.float32(0)) ** 2, (far + offset) ** 2
                for u in range(width):
                    q = candidate[j, u]
                    cos = turned[i, t, 0] * turned[j, u, 0] + turned[i, t, 1] * turned[j, u, 1]
                    if q < 0 or cos <= least_cos or floor[p] != floor[q]:
                        continue
                    square = (pose_a[q, 0] - pose_a[p, 0]) ** 2 + (pose_a[q, 1] - pose_a[p, 1]) ** 2
                    if square <= low or square >= high:
                        continue
                    slides = abs(half_s[i] - half_a[p]), abs(half_s[j] - half_a[q])
                    sin, cos = _left(in_s, _related(pose_a[p], pose_a[q]), slides, offsets[count])
                    if offsets[count, :4].max() >= LEFT_M:
                        continue
                    housed, same_s = home_s[i] >= 0 and home_s[j] >= 0, home_s[i] == home_s[j]
                    same_a = home_a[p] == home_a[q] and home_a[p] >= 0
                    row = columns[count]
                    row[0], row[1], row[2], row[3], row[4] = abs(sin), cos, in_s[4], far, 0.0
                    row[5], row[6], row[7] = same_s and housed, same_s == same_a and housed, p == q
                    row[8] = slides[0] + slides[1]
                    pair[count], other[count] = i * width + t, j * width + u
                    count += 1
    return pair[:count].copy(), other[:count].copy(), offsets[:count].T.copy(), columns[:count].T.copy()


@compiled
def _related(i: Array32, j: Array32) -> tuple[float, float, float, float, float, float]:
    """As `relations.Relation` has it, of two walls' poses."""
    x, y = j[0] - i[0], j[1] - i[1]
    return (
        x * i[2] + y * i[3], y * i[2] - x * i[3], -(x * j[2] + y * j[3]), x * j[3] - y * j[2],
        i[2] * j[2] + i[3] * j[3], i[2] * j[3] - i[3] * j[2],
    )  # fmt: skip


@compiled
def _left(
    of_s: tuple[float, ...], of_a: tuple[float, ...], slides: tuple[float, float], offsets: NDArray[np.float32]
) -> tuple[float, float]:
    """Writes (OFFSETS,) what two relations' offsets differ by, less what ends slide, and those across as they are;
    returns sine and cosine of the angle between them."""
    one, other = slides
    cos, sin = abs(of_s[4]), abs(of_s[5])
    slack = other * sin, one + other * cos, one * sin, other + one * cos
    for d in range(4):
        offsets[d] = max(abs(of_s[d] - of_a[d]) - slack[d], 0.0)
    offsets[4], offsets[5] = abs(of_s[0] - of_a[0]), abs(of_s[2] - of_a[2])
    return of_s[5] * of_a[4] - of_s[4] * of_a[5], of_s[4] * of_a[4] + of_s[5] * of_a[5]
