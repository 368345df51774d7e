"""Training of the published matcher: permutation loss, AdamW, early stopping, bitwise resumption."""

import copy
import io
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from data.common.errors import UserError
from data.common.files import write_atomically
from matching.published.data import PaperPair, PaperSplit, nodes_of
from matching.published.network import PaperNetwork, PaperSettings

LEAST_PROBABILITY = 1e-9
EVALUATED_AT_ONCE = 64  # pairs of a batch in evaluation
Row = dict[str, float]


@dataclass(frozen=True)
class Recipe:
    """Training parameters; the defaults are the paper's."""

    rate: float = 1e-3
    decay: float = 5e-5
    batch: int = 16
    epochs: int = 500
    patience: int = 100  # epochs without a smaller loss of the validation set

    def to_dict(self) -> dict[str, Any]:
        """Returns the parameters as plain data."""
        return asdict(self)


RECIPES = {"published": Recipe(), "repository": Recipe(rate=8.10e-4, decay=1.24e-5, batch=32)}


def permutation_loss(soft: Sequence[Tensor], pairs: Sequence[PaperPair]) -> Tensor:
    """Mean over pairs of the mean binary cross-entropy over all entries of the assignment (PCA-GM)."""
    return torch.stack([_entropy(p, pair.assignment()) for p, pair in zip(soft, pairs, strict=True)]).mean()


def _entropy(soft: Tensor, truth: Tensor) -> Tensor:
    p = soft.clamp(LEAST_PROBABILITY, 1 - 1e-7)  # close to 1, within single precision
    return -(truth * p.log() + (1 - truth) * torch.log1p(-p)).mean()


@dataclass
class PaperTraining:
    """The state of a training run; `best` is the network's state at the lowest validation loss."""

    network: PaperNetwork
    optimizer: torch.optim.Optimizer
    recipe: Recipe
    seed: int
    data: str  # identifies the training pairs
    curve: list[Row] = field(default_factory=list)
    best: dict[str, Any] | None = None
    seconds: float = 0.0

    @staticmethod
    def begin(settings: PaperSettings, recipe: Recipe, pairs: PaperSplit, seed: int) -> "PaperTraining":
        """Creates an untrained network, standardised by the nodes of the training pairs."""
        torch.manual_seed(seed)
        network = PaperNetwork(settings)
        network.standardise_by(torch.cat([nodes.features for nodes in nodes_of(pairs.train)]))
        optimizer = torch.optim.AdamW(network.parameters(), recipe.rate, weight_decay=recipe.decay)
        data = blake2b(digest_size=8)
        for pair in pairs.train:
            data.update(pair.a.features.tobytes() + pair.s.features.tobytes())
        return PaperTraining(network, optimizer, recipe, seed, data.hexdigest())

    def save(self, path: Path) -> None:
        """Writes the state atomically."""
        value = {k: getattr(self, k) for k in ("seed", "data", "curve", "best", "seconds")}
        value |= {"settings": self.network.settings.to_dict(), "recipe": self.recipe.to_dict()}
        value |= {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}
        buffer = io.BytesIO()
        torch.save(value, buffer)
        write_atomically(path, buffer.getvalue())

    def load(self, path: Path) -> None:
        """Resumes from a saved run. Only the number of epochs may differ.

        Raises UserError if anything else does.
        """
        value = torch.load(path, map_location="cpu", weights_only=True)
        recipe = replace(Recipe(**value["recipe"]), epochs=self.recipe.epochs, patience=self.recipe.patience)
        own = {"settings": self.network.settings.to_dict(), "seed": self.seed, "recipe": self.recipe, "data": self.data}
        for of, found in {**value, "recipe": recipe}.items():
            if own.get(of, found) != found:
                raise UserError(f"{path}: a run with another {of}; give another --out or delete it")
        self.network.load_state_dict(value["network"])
        self.optimizer.load_state_dict(value["optimizer"])
        self.curve, self.best, self.seconds = value["curve"], value["best"], value["seconds"]

    def best_network(self) -> PaperNetwork:
        """Returns the network of the best epoch, ready for inference."""
        network = copy.deepcopy(self.network)
        if self.best is not None:
            network.load_state_dict(self.best)
        return network.eval().requires_grad_(False)


def train(
    training: PaperTraining, pairs: PaperSplit, on_evaluation: Callable[[Row], None], minutes: float = np.inf
) -> str:
    """Trains until the epochs are done, the minutes are over or nothing improves; returns which of these ended it.

    `on_evaluation` is called with the row of each epoch.
    """
    recipe = training.recipe
    while True:
        losses = [row["validation loss"] for row in training.curve]
        if len(losses) >= recipe.epochs:
            return "all epochs done"
        if losses and len(losses) - 1 - losses.index(min(losses)) >= recipe.patience:
            return f"no improvement in {recipe.patience} epochs"
        if training.seconds > 60 * minutes:
            return f"{minutes:g} minutes over"
        began = time.monotonic()
        row = {"epoch": float(len(losses)), "loss": _epoch(training, pairs.train)}
        loss, accuracy = evaluate(training.network, pairs.validation)
        row |= {"validation loss": loss, "validation accuracy": accuracy}
        if loss <= min(losses, default=loss):
            training.best = copy.deepcopy(training.network.state_dict())
        training.seconds += time.monotonic() - began
        row["minutes"] = training.seconds / 60
        training.curve.append(row)
        on_evaluation(row)


def _epoch(training: PaperTraining, pairs: Sequence[PaperPair]) -> float:
    """Trains on every pair once, in an order drawn for the epoch; returns the mean loss."""
    epoch = len(training.curve)
    order = np.random.default_rng([training.seed, epoch]).permutation(len(pairs)).tolist()
    torch.manual_seed(training.seed * 1_000_003 + epoch)  # of the dropouts
    training.network.train()
    total = 0.0
    for first in range(0, len(order), training.recipe.batch):
        batch = [pairs[k] for k in order[first : first + training.recipe.batch]]
        loss = permutation_loss(training.network(*nodes_of(batch)), batch)
        training.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        training.optimizer.step()
        total += loss.item() * len(batch)
    return total / len(order)


@torch.no_grad()
def evaluate(network: PaperNetwork, pairs: Sequence[PaperPair]) -> tuple[float, float]:
    """Returns the loss and the share of matched S nodes whose assignment is right."""
    network.eval()
    loss, right, all_of = 0.0, 0, 0
    for first in range(0, len(pairs), EVALUATED_AT_ONCE):
        batch = pairs[first : first + EVALUATED_AT_ONCE]
        soft = network(*nodes_of(batch))
        loss += permutation_loss(soft, batch).item() * len(batch)
        for p, pair in zip(soft, batch, strict=True):
            a, s = linear_sum_assignment(p.numpy(), maximize=True)
            right += int((pair.match[s] == a).sum())
            all_of += int((pair.match >= 0).sum())
    return loss / max(len(pairs), 1), right / max(all_of, 1)
