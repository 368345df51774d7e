"""The training loss, and the accuracies shown during training."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from matching.network.encoder import GraphTensors
from matching.network.network import Output
from matching.network.registry import Network
from matching.training.data import Batch

MOST_SURPRISE = 10.0  # nats of one wall, also of a partner that is no candidate


@dataclass(frozen=True)
class Truth:
    """True columns, counted from the plan's first, -1 for none: (N,) of S walls, (M,) of S rooms."""

    walls: Tensor
    rooms: Tensor


def run(network: Network, batch: Batch, device: torch.device) -> tuple[Output, Truth]:
    """Returns the network's output for a batch and the truth as tensors."""
    s = network.encode(GraphTensors.of(batch.s, device))
    a = network.encode(GraphTensors.of(batch.a, device))
    truth = Truth(torch.as_tensor(batch.walls).to(device), torch.as_tensor(batch.rooms).to(device))
    return network(s, a, list(batch.pairs)), truth


def loss(output: Output, truth: Truth) -> Tensor:
    """Negative log likelihood of the true matches (or of no match), after every round; later rounds weigh more."""
    total = 0.5 * cross_entropy(output.dense, _target(truth.walls, output.dense))
    total = total + 0.25 * _by_plan(output.dense, truth.walls)
    whole = len(output.walls) * (len(output.walls) + 1) / 2
    for k, (column, table) in enumerate(output.walls):
        at = (column == truth.walls[:, None]) & (truth.walls >= 0)[:, None]
        target = torch.where(at.any(dim=1), at.long().argmax(dim=1), column.shape[1])  # "none of these" where missed
        total = total + (k + 1) / whole * cross_entropy(table, target)
    if len(truth.rooms):
        for k, table in enumerate(output.rooms):
            weight = 0.5 * (k + 1) / (whole + len(output.rooms))
            total = total + weight * cross_entropy(table, _target(truth.rooms, table))
    return total


def surprise(output: Output, truth: Truth) -> float:
    """Mean negative log likelihood of the true wall matches (or of no match) after the last round, in nats."""
    column, table = output.walls[-1]
    odds = table.log_softmax(dim=-1)
    at = column == truth.walls[:, None]
    found = torch.where(at.any(dim=1), odds.gather(1, at.long().argmax(dim=1, keepdim=True))[:, 0], -MOST_SURPRISE)
    return float(-torch.where(truth.walls >= 0, found, odds[:, -1]).clamp(min=-MOST_SURPRISE).mean())


def _target(truth: Tensor, table: Tensor) -> Tensor:
    return torch.where(truth >= 0, truth, table.shape[1] - 1)


def _by_plan(dense: Tensor, truth: Tensor) -> Tensor:
    """The reverse direction: each A wall with a match must find it among the map's walls.

    All maps of a batch compete, which adds negatives.
    """
    found = truth >= 0
    if not found.any():
        return dense.sum() * 0
    reverse = dense[:, :-1].log_softmax(dim=0)
    return -reverse[found.nonzero()[:, 0], truth[found]].mean()


def accuracies(output: Output, truth: Truth) -> dict[str, tuple[float, int]]:
    """Returns shares and the numbers they are taken of.

    `walls`, `rooms`: best partner is the true one; `first`: the same for walls before consensus; `none`: walls without
    a match that stay unmatched; `within`: true partners among the candidates.
    """
    column, table = output.walls[-1]
    best = column.gather(1, table[:, :-1].argmax(dim=1, keepdim=True))[:, 0]
    has = truth.walls >= 0
    none = table.argmax(dim=1) == column.shape[1]
    within = (column == truth.walls[:, None]).any(dim=1)
    values = {"walls": (best == truth.walls)[has], "none": none[~has], "within": within[has]}
    values["first"] = (output.dense[:, :-1].argmax(dim=1) == truth.walls)[has]
    if len(truth.rooms):
        room = output.rooms[-1][:, :-1].argmax(dim=1) == truth.rooms
        values["rooms"] = room[truth.rooms >= 0]
    return {k: (float(v.float().mean()) if len(v) else 0.0, len(v)) for k, v in values.items()}
