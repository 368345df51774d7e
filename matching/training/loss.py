"""The training loss, and the measures shown during training."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, pad

from matching.proposals.network import NOTHING, Graph, MatchingNetwork, Output
from matching.training.data import Batch

MOST_SURPRISE = 10.0  # nats of one wall, also of a partner that is no candidate


class Result(NamedTuple):
    """The output for one pair, and the true columns of its walls (N,) and rooms (M,), -1 for none."""

    output: Output
    walls: Tensor
    rooms: Tensor


def run(network: MatchingNetwork, batch: Batch) -> list[Result]:
    """Runs the network on all pairs of a batch."""
    device = network.sharpness.device
    plans, found = [network.encode(Graph.of(plan, device)) for plan in batch.plans], []
    for pair in batch.pairs:
        output = network(network.encode(Graph.of(pair.s, device)), plans[pair.plan])
        found.append(Result(output, *(torch.as_tensor(true).to(device) for true in (pair.walls, pair.rooms))))
    return found


def loss(results: Sequence[Result]) -> Tensor:
    """Negative log likelihood of the true matches (or of no match), after every round; later rounds weigh more."""
    rounds = len(results[0].output.walls)
    whole = rounds * (rounds + 1) / 2
    total = 0.5 * _mean([_surprise(r.output.dense, r.walls) for r in results]) + 0.25 * _by_plan(results)
    for k in range(rounds):
        total = total + (k + 1) / whole * _mean([_of_candidates(*r.output.walls[k], r.walls) for r in results])
    for k in range(rounds + 1):
        weight = 0.5 * (k + 1) / (whole + rounds + 1)
        total = total + weight * _mean([_surprise(r.output.rooms[k], r.rooms) for r in results])
    return total


def _mean(values: list[Tensor]) -> Tensor:
    every = torch.cat(values)
    return every.sum() / max(len(every), 1)


def _surprise(table: Tensor, truth: Tensor) -> Tensor:
    """(N,) of logits (N, columns + 1), whose last is no match."""
    return cross_entropy(table, torch.where(truth >= 0, truth, table.shape[1] - 1), reduction="none")


def _of_candidates(column: Tensor, table: Tensor, truth: Tensor) -> Tensor:
    """(N,) of logits of candidates; where the true one is missing, "none of these" is right."""
    at = (column == truth[:, None]) & (truth >= 0)[:, None]
    return _surprise(table, torch.where(at.any(dim=1), at.long().argmax(dim=1), -1))


def _by_plan(results: Sequence[Result]) -> Tensor:
    """The reverse direction: each planned wall with a match must find it among the walls of the batch's maps.

    Maps of other plans compete as well, which adds negatives.
    """
    wide = max(r.output.dense.shape[1] for r in results)
    tables = [r.output.dense[:, :-1] for r in results]
    dense = torch.cat([pad(table, (0, wide - table.shape[1]), value=NOTHING) for table in tables])
    truth = torch.cat([r.walls for r in results])
    rows = (truth >= 0).nonzero()[:, 0]
    return _mean([-dense.log_softmax(dim=0)[rows, truth[rows]]])


def measures(results: Sequence[Result]) -> dict[str, float]:
    """Means over the walls and rooms of a batch, left out where there are none.

    `walls`, `rooms`: the best partner is the true one; `first`: the same for walls before consensus; `none`: walls
    without a match stay unmatched; `within`: true partners are among the candidates; `surprise`: negative log
    likelihood of the true partners of walls (or of no match), in nats.
    """
    values: dict[str, list[Tensor]] = {}
    for output, walls, rooms in results:
        (column, table), has = output.walls[-1], walls >= 0
        best = column.gather(1, table[:, :-1].argmax(dim=1, keepdim=True))[:, 0]
        within = (column == walls[:, None]).any(dim=1)
        surprise = _of_candidates(column, table, walls).clamp(max=MOST_SURPRISE)
        for name, found in {
            "walls": (best == walls)[has],
            "none": (table.argmax(dim=1) == column.shape[1])[~has],
            "within": within[has],
            "first": (output.dense[:, :-1].argmax(dim=1) == walls)[has],
            "rooms": (output.rooms[-1][:, :-1].argmax(dim=1) == rooms)[rooms >= 0] if len(rooms) else rooms,
            "surprise": torch.where(has & ~within, MOST_SURPRISE, surprise),
        }.items():
            values.setdefault(name, []).append(found.float())
    return {name: _mean(found).item() for name, found in values.items() if sum(map(len, found))}
