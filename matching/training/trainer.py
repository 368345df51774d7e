"""The training loop: the loss, steps, an exponential moving average of the weights, evaluation, resumption."""

import copy
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, pad

from data.common.errors import UserError
from data.common.files import atomic_file, write_atomically
from matching.proposals.network import NOTHING, Graph, MatchingNetwork, Output, Settings
from matching.training.data import Batch

RATE, WEIGHT_DECAY, WARM_UP = 2e-3, 1e-3, 100  # of AdamW; steps
LAST_RATE = 0.03  # of the first, at the end of a cosine
AVERAGED = 0.997  # of the weights, at each step
LARGEST_GRADIENT = 2.0
MOST_SURPRISE = 10.0  # nats of one wall, also of a partner that is no candidate
STATES = ("network", "average", "optimizer")
MEASURES = ("walls", "rooms", "none", "within", "first", "surprise")
Row = dict[str, float]


class Result(NamedTuple):
    """The output for one pair, and the true columns of its walls (N,) and rooms (M,), -1 for none."""

    output: Output
    walls: Tensor
    rooms: Tensor


@dataclass
class Training:
    """The state of a run; `curve` has a row for each evaluation of the averaged network."""

    network: MatchingNetwork
    average: MatchingNetwork
    optimizer: torch.optim.Optimizer
    step: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)

    @staticmethod
    def begin(settings: Settings, seed: int, device: str) -> "Training":
        """Creates an untrained network; the same for the same seed."""
        torch.manual_seed(seed)
        network = MatchingNetwork(settings).to(device)
        average = copy.deepcopy(network).requires_grad_(False)
        return Training(network, average, torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY))

    @property
    def best(self) -> Row:
        """The row of the best evaluation so far, the first of equal ones."""
        return min(self.curve, key=lambda row: row["surprise"])

    def save(self, path: Path) -> None:
        """Writes the state atomically."""
        states = {name: getattr(self, name).state_dict() for name in STATES}
        with atomic_file(path) as file:
            torch.save({**vars(self), **states}, file)

    def load(self, path: Path) -> None:
        """Resumes from a saved run. Raises UserError if it is of another network."""
        value = torch.load(path, map_location="cpu", weights_only=True)
        try:
            for name in STATES:
                getattr(self, name).load_state_dict(value[name])
        except (RuntimeError, ValueError):
            raise UserError(f"{path}: of another network; give another --out or delete it") from None
        self.step, self.seconds, self.curve = (value[name] for name in ("step", "seconds", "curve"))

    def learn(self, batch: Batch, progress: float) -> float:
        """Makes a step and returns the loss; `progress` in [0, 1] sets the rate."""
        cosine = (1 + math.cos(math.pi * progress)) / 2
        rate = RATE * min(1.0, (self.step + 1) / WARM_UP) * (LAST_RATE + (1 - LAST_RATE) * cosine)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        value = loss(run(self.network, batch))
        self.optimizer.zero_grad()
        value.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), LARGEST_GRADIENT)
        self.optimizer.step()
        kept = min(AVERAGED, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, 1 - kept)
        self.step += 1
        return value.item()

    def evaluate(self, held_out: Mapping[str, Batch], loss: float) -> Row:
        """Adds a row to the curve, with the measures of each held-out batch and their means, and returns it."""
        row: Row = {"step": self.step, "minutes": self.seconds / 60, "loss": loss}
        with torch.no_grad():
            found = {name: measures(run(self.average, batch)) for name, batch in held_out.items()}
        row |= {f"{name} {measure}": value for name, of in found.items() for measure, value in of.items()}
        for measure in MEASURES:
            values = [of[measure] for of in found.values() if measure in of]
            row[measure] = sum(values) / max(len(values), 1)
        self.curve.append(row)
        return row


def train(
    training: Training, stream: Iterator[Batch], held_out: Mapping[str, Batch], steps: int, every: int,
    minutes: float = math.inf,
) -> Iterator[Row]:  # fmt: skip
    """Trains until these steps are done or these minutes are over. `stream` begins with the batch of `training.step`.

    Yields the new row of the curve after each evaluation on the held-out batches: all `every` steps, and at the end.
    """
    began = time.monotonic() - training.seconds
    losses: list[float] = []
    progress = 0.0
    while progress < 1:
        training.seconds = time.monotonic() - began
        progress = max(training.step / steps, training.seconds / 60 / minutes)
        if losses and (progress >= 1 or training.step % every == 0):
            yield training.evaluate(held_out, sum(losses) / len(losses))
            losses = []
        if progress < 1:
            losses.append(training.learn(next(stream), progress))


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


def write_curve(path: Path, curve: Sequence[Row]) -> None:
    """Writes a table (.csv) with a row for each evaluation."""
    names = list(dict.fromkeys(name for row in curve for name in row))
    lines = [names, *([f"{row[name]:.6g}" if name in row else "" for name in names] for row in curve)]
    write_atomically(path, "".join(",".join(line) + "\n" for line in lines))
