"""The training loop: steps, an exponential moving average of the weights, evaluation, resumption."""

import copy
import io
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from data.common.errors import UserError
from data.common.files import write_atomically
from matching.proposals.network import MatchingNetwork, Settings
from matching.training.data import Batch
from matching.training.loss import loss, measures, run

RATE, WEIGHT_DECAY, WARM_UP = 2e-3, 1e-3, 100  # of AdamW; steps
LAST_RATE = 0.03  # of the first, at the end of a cosine
AVERAGED = 0.997  # of the weights, at each step
LARGEST_GRADIENT = 2.0
Row = dict[str, float]
HeldOut = Mapping[str, Batch]


@dataclass(frozen=True)
class Limits:
    """When training ends: after this many steps or minutes, or `patience` evaluations without improvement."""

    steps: int
    minutes: float = math.inf
    every: int = 250  # steps between evaluations on the held-out buildings
    patience: int = 20


@dataclass
class Training:
    """The state of a run; `best` is the averaged network at its best evaluation."""

    network: MatchingNetwork
    average: MatchingNetwork
    optimizer: torch.optim.Optimizer
    step: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)
    best: dict[str, Any] | None = None

    @staticmethod
    def begin(settings: Settings, seed: int, device: str) -> "Training":
        """Creates an untrained network; the same for the same seed."""
        torch.manual_seed(seed)
        network = MatchingNetwork(settings).to(device)
        average = copy.deepcopy(network).requires_grad_(False)
        return Training(network, average, torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY))

    def save(self, path: Path) -> None:
        """Writes the state atomically."""
        state = {name: getattr(self, name).state_dict() for name in ("network", "average", "optimizer")}
        rest = {name: getattr(self, name) for name in ("step", "seconds", "curve", "best")}
        buffer = io.BytesIO()
        torch.save(state | rest, buffer)
        write_atomically(path, buffer.getvalue())

    def load(self, path: Path) -> None:
        """Resumes from a saved run. Raises UserError if it is of another network."""
        value = torch.load(path, map_location="cpu", weights_only=True)
        try:
            for name in ("network", "average", "optimizer"):
                getattr(self, name).load_state_dict(value[name])
        except (RuntimeError, ValueError):
            raise UserError(f"{path}: of another network; give another --out or delete it") from None
        self.step, self.seconds, self.curve, self.best = (value[k] for k in ("step", "seconds", "curve", "best"))

    def best_network(self) -> MatchingNetwork:
        """Returns the averaged weights at the best evaluation."""
        network = copy.deepcopy(self.average)
        if self.best is not None:
            network.load_state_dict(self.best)
        return network

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

    def evaluate(self, held_out: HeldOut, loss: float) -> Row:
        """Adds a row to the curve, with the measures of each held-out batch and their means, and returns it."""
        row: Row = {"step": self.step, "minutes": self.seconds / 60, "loss": loss}
        with torch.no_grad():
            found = {name: measures(run(self.average, batch)) for name, batch in held_out.items()}
        row |= {f"{name} {measure}": value for name, of in found.items() for measure, value in of.items()}
        for measure in ("walls", "rooms", "none", "within", "first", "surprise"):
            values = [of[measure] for of in found.values() if measure in of]
            row[measure] = sum(values) / max(len(values), 1)
        if all(row["surprise"] < earlier["surprise"] for earlier in self.curve):
            self.best = copy.deepcopy(self.average.state_dict())
        self.curve.append(row)
        return row

    def stale(self) -> int:
        """The number of evaluations since the best one."""
        surprise = [row["surprise"] for row in self.curve]
        return len(surprise) - 1 - surprise.index(min(surprise))


def train(
    training: Training, stream: Iterator[Batch], held_out: HeldOut, limits: Limits, on_evaluation: Callable[[Row], None]
) -> str:
    """Trains until a limit is reached and returns which. `stream` begins with the batch of `training.step`.

    `on_evaluation` is called after each evaluation on the held-out buildings, with the new row of the curve.
    """
    began = time.monotonic() - training.seconds
    losses: list[float] = []
    while True:
        training.seconds = time.monotonic() - began
        progress = max(training.step / limits.steps, training.seconds / 60 / limits.minutes)
        ended = "all steps done" if progress >= 1 else None
        if losses and (ended or training.step % limits.every == 0):
            on_evaluation(training.evaluate(held_out, sum(losses) / len(losses)))
            losses = []
            if training.stale() >= limits.patience:
                ended = f"no improvement in {limits.patience} evaluations"
        if ended:
            return ended
        losses.append(training.learn(next(stream), progress))
