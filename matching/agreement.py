"""How much of the map agrees with a candidate: with the motion that lays wall i on wall a, where do the others fall?

Consensus is local, and plans repeat themselves: storeys, twins, rows of offices. What the whole map says tells them
apart. The further off a wall, the more the map may have bent on the way.
"""

import torch
from torch import Tensor

from matching.candidates import Batched, Candidates
from matching.encoder import GraphTensors

AGREEMENTS = 3  # within the sharp reach, within the wide one, and the latter beside the best candidate's
REACHES = ((0.5, 0.03), (1.5, 0.1))  # metres, and metres for each metre of distance
VOTERS = 64  # candidates that are asked: the likeliest, the largest
LEAST_COS = 0.97  # of the angle between two motions that may agree
CHUNK = 1 << 21  # comparisons at once


def agreement(s: GraphTensors, a: GraphTensors, batched: Batched, c: Candidates, likely: Tensor) -> Tensor:
    """(N, K, AGREEMENTS) shares, in [0, 1], of what the map's likeliest candidates say."""
    found = torch.zeros((*likely.shape, AGREEMENTS), device=likely.device)
    for first, last in batched.rows:
        found[first:last, :, :2] = _shares(s, a, c.row[first:last], likely[first:last], s.wall_node[first:last])
        found[first:last, :, 2] = found[first:last, :, 1] / (found[first:last, :, 1].max() + 1e-3)
    return found


def _shares(s: GraphTensors, a: GraphTensors, row: Tensor, likely: Tensor, wall: Tensor) -> Tensor:
    """(n, K, 2) for the walls of one pair; `wall` (n,) their nodes."""
    partner = a.wall_node[row.clamp(min=0)]
    turn = a.heading[partner] - s.heading[wall][:, None]
    place, floor = a.centre[partner], a.floor[partner]
    size = torch.sqrt((2 * s.half[wall]).clamp(0.35, 6.0))
    voice, at = (likely * size[:, None]).flatten().topk(min(VOTERS, likely.numel()))
    i, k = at // likely.shape[1], at % likely.shape[1]
    voice = (voice / voice.sum().clamp(min=1e-3))[None, None]
    cos, sin = turn.cos()[..., None], turn.sin()[..., None]
    parts = []
    for rows in torch.arange(len(wall), device=wall.device).split(max(1, CHUNK // (len(i) * row.shape[1]))):
        away = (s.centre[wall[i]][None] - s.centre[wall[rows]][:, None])[:, None]  # (rows, 1, V, 2)
        x = cos[rows] * away[..., 0] - sin[rows] * away[..., 1] + place[rows, :, None, 0] - place[i, k, 0]
        y = sin[rows] * away[..., 0] + cos[rows] * away[..., 1] + place[rows, :, None, 1] - place[i, k, 1]
        heard = (floor[rows][..., None] == floor[i, k]) & (rows[:, None] != i)[:, None]
        heard &= (turn[rows][..., None] - turn[i, k]).cos() > LEAST_COS
        off, far = x**2 + y**2, away.norm(dim=-1)
        says = [torch.exp(-0.5 * off / (near + slope * far) ** 2) * heard * voice for near, slope in REACHES]
        parts.append(torch.stack([share.sum(dim=-1) for share in says], dim=-1))
    return torch.cat(parts)
