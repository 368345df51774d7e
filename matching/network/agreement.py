"""Global agreement: under the motion that aligns wall i with wall a, how many of the map's other candidates agree?

Consensus is local, and plans repeat themselves: storeys, symmetric flats, rows of offices. The whole map tells them
apart. The tolerance grows with distance, since the map may have drifted on the way.
"""

import torch
from torch import Tensor

from matching.network.candidates import Batched, Candidates
from matching.network.dimensions import AGREEMENTS, LEAST_VOTER_COS, REACHES, VOTERS
from matching.network.encoder import GraphTensors

CHUNK = 1 << 21  # comparisons at once


def agreement(s: GraphTensors, a: GraphTensors, batched: Batched, c: Candidates, likely: Tensor) -> Tensor:
    """(N, K, AGREEMENTS) shares in [0, 1] of the map's likeliest candidates that agree with each candidate."""
    found = torch.zeros((*likely.shape, AGREEMENTS), device=likely.device)
    for first, last in batched.rows:
        found[first:last, :, :2] = _shares(s, a, c.row[first:last], likely[first:last], s.wall_node[first:last])
        found[first:last, :, 2] = found[first:last, :, 1] / (found[first:last, :, 1].max() + 1e-3)
    return found


def _shares(s: GraphTensors, a: GraphTensors, row: Tensor, likely: Tensor, wall: Tensor) -> Tensor:
    """(n, K, 2) shares for the walls of one pair; `wall` (n,) are their nodes."""
    size = torch.sqrt((2 * s.half[wall]).clamp(0.35, 6.0))
    voice, at = (likely * size[:, None]).flatten().topk(min(VOTERS, likely.numel()))
    i = at // likely.shape[1]
    voice = voice / voice.sum().clamp(min=1e-3)
    partner = a.wall_node[row.clamp(min=0)]
    own, theirs = s.pose[wall], a.pose[partner]
    (c, s_), (u, v) = own[:, None, 2:].unbind(-1), theirs[..., 2:].unbind(-1)
    cos, sin = c * u + s_ * v, c * v - s_ * u  # of the motion's yaw
    turn = torch.stack((cos, sin), dim=-1).flatten(0, 1)  # (n K, 2)
    # The voters' walls under the motion, minus the positions of their candidates.
    motion = torch.stack((cos, -sin, theirs[..., 0], sin, cos, theirs[..., 1]), dim=-1)
    place, floor = theirs.flatten(0, 1)[at], a.floor[partner].flatten()
    parts = []
    for rows in torch.arange(len(wall), device=wall.device).split(max(1, CHUNK // (len(i) * row.shape[1]))):
        away = own[i, :2] - own[rows, None, :2]  # (rows, V, 2)
        homogeneous = torch.cat((away.mT, torch.ones_like(away[:, None, :, 0])), dim=1)  # (rows, 3, V)
        x = torch.bmm(motion[rows, :, :3], homogeneous) - place[:, 0]
        y = torch.bmm(motion[rows, :, 3:6], homogeneous) - place[:, 1]
        heard = (turn.view(*u.shape, 2)[rows].flatten(0, 1) @ turn[at].T > LEAST_VOTER_COS).view(x.shape)
        heard &= (rows[:, None] != i)[:, None]
        if a.many_floors:
            heard &= floor.view(u.shape)[rows][..., None] == floor[at]
        off, far = x * x + y * y, away.norm(dim=-1)
        says = [torch.exp(off * (-0.5 / (near + slope * far) ** 2)[:, None]) * heard for near, slope in REACHES]
        parts.append(torch.stack(says, dim=-2) @ voice)
    return torch.cat(parts)
