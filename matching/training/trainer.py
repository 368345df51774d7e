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
from matching.network.registry import AnySettings, Network, network_of
from matching.training.data import Batch
from matching.training.loss import accuracies, loss, run, surprise

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

    network: Network
    average: Network
    optimizer: torch.optim.Optimizer
    step: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)
    best: dict[str, Any] | None = None

    @staticmethod
    def begin(settings: AnySettings, seed: int, device: torch.device) -> "Training":
        """Creates an untrained network; the same for the same seed."""
        torch.manual_seed(seed)
        network = network_of(settings).to(device)
        average = copy.deepcopy(network).requires_grad_(False)
        return Training(network, average, torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY))

    def save(self, path: Path) -> None:
        """Writes the state atomically."""
        value: dict[str, Any] = {"network": self.network.state_dict(), "average": self.average.state_dict()}
        value |= {"optimizer": self.optimizer.state_dict(), "step": self.step, "seconds": self.seconds}
        value |= {"curve": self.curve, "best": self.best}
        buffer = io.BytesIO()
        torch.save(value, buffer)
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

    def best_network(self) -> Network:
        """Returns the averaged weights at the best evaluation."""
        network = copy.deepcopy(self.average)
        if self.best is not None:
            network.load_state_dict(self.best)
        return network


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
            on_evaluation(_evaluated(training, held_out, losses))
            losses = []
            if _stale(training.curve) >= limits.patience:
                ended = f"no improvement in {limits.patience} evaluations"
        if ended:
            return ended
        losses.append(_step(training, next(stream), progress))


def _step(training: Training, batch: Batch, progress: float) -> float:
    warm = min(1.0, (training.step + 1) / WARM_UP)
    rate = RATE * warm * (LAST_RATE + (1 - LAST_RATE) * (1 + math.cos(math.pi * progress)) / 2)
    for group in training.optimizer.param_groups:
        group["lr"] = rate
    device = next(training.network.parameters()).device
    value = loss(*run(training.network, batch, device))
    training.optimizer.zero_grad()
    value.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_(training.network.parameters(), LARGEST_GRADIENT)
    training.optimizer.step()
    kept = min(AVERAGED, (1 + training.step) / (10 + training.step))
    with torch.no_grad():
        for mean, now in zip(training.average.parameters(), training.network.parameters(), strict=True):
            mean.lerp_(now, 1 - kept)
    training.step += 1
    return value.item()


def _evaluated(training: Training, held_out: HeldOut, losses: list[float]) -> Row:
    row: Row = {"step": training.step, "minutes": training.seconds / 60, "loss": sum(losses) / len(losses)}
    row |= evaluate(training.average, held_out)
    if all(row["surprise"] < earlier["surprise"] for earlier in training.curve):
        training.best = copy.deepcopy(training.average.state_dict())
    training.curve.append(row)
    return row


def evaluate(network: Network, held_out: HeldOut) -> Row:
    """Returns accuracies and surprise of each held-out batch, as `NAME MEASURE`, and their means over the batches."""
    device = next(network.parameters()).device
    row: Row = {}
    with torch.no_grad():
        network.eval()
        for name, batch in held_out.items():
            output, truth = run(network, batch, device)
            row |= {f"{name} {k}": v for k, (v, count) in accuracies(output, truth).items() if count}
            row[f"{name} surprise"] = surprise(output, truth)
    for measure in ("walls", "rooms", "none", "within", "first", "surprise"):
        values = [v for k, v in row.items() if k.endswith(f" {measure}")]
        row[measure] = sum(values) / max(len(values), 1)
    return row


def _stale(curve: list[Row]) -> int:
    surprise = [row["surprise"] for row in curve]
    return len(surprise) - 1 - surprise.index(min(surprise)) if surprise else 0
