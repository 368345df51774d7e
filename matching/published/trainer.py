"""Training of the published matcher: permutation loss, AdamW, early stopping."""

import copy
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from matching.published.data import PaperPair
from matching.published.network import PaperNetwork, PaperSettings

LEAST_PROBABILITY = 1e-9
PATIENCE = 20  # epochs without a smaller validation loss
EVALUATED_AT_ONCE = 64  # pairs of a batch in evaluation
Row = dict[str, float]


def train(
    settings: PaperSettings, pairs: Sequence[PaperPair], validation: Sequence[PaperPair], seed: int, epochs: int
) -> Iterator[tuple[PaperNetwork, list[Row]]]:
    """Trains until the epochs are done or the validation loss no longer falls. The same seed gives the same weights.

    Yields after each epoch the network of the lowest validation loss, ready for inference, and a row for each epoch.
    """
    torch.set_num_threads(1)  # several add up in another order each time, and are slower on graphs this small
    torch.manual_seed(seed)
    network = PaperNetwork(settings)
    network.standardise_by([p.a for p in pairs] + [p.s for p in pairs])
    optimizer = torch.optim.AdamW(network.parameters(), settings.rate, weight_decay=settings.decay)
    best, best_epoch = copy.deepcopy(network), 0
    curve: list[Row] = []
    for epoch in range(epochs):
        torch.manual_seed(seed * 1_000_003 + epoch)  # of the dropouts
        order = np.random.default_rng([seed, epoch]).permutation(len(pairs))
        row = {"epoch": float(epoch), "loss": _epoch(network, optimizer, [pairs[k] for k in order])}
        row["validation loss"], row["validation accuracy"] = evaluate(network, validation)
        curve.append(row)
        if row["validation loss"] <= min(r["validation loss"] for r in curve):
            best, best_epoch = copy.deepcopy(network).requires_grad_(False), epoch
        yield best, curve
        if epoch - best_epoch >= PATIENCE:
            break


def _epoch(network: PaperNetwork, optimizer: torch.optim.Optimizer, pairs: Sequence[PaperPair]) -> float:
    """Trains on every pair once, in order; returns the mean loss."""
    network.train()
    total, size = 0.0, network.settings.batch
    for first in range(0, len(pairs), size):
        batch = pairs[first : first + size]
        loss = permutation_loss(network([p.a for p in batch], [p.s for p in batch]), batch)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        total += loss.item() * len(batch)
    return total / len(pairs)


def permutation_loss(soft: Sequence[Tensor], pairs: Sequence[PaperPair]) -> Tensor:
    """Mean over pairs of the mean binary cross-entropy over all entries of the assignment (PCA-GM)."""
    losses = []
    for p, pair in zip(soft, pairs, strict=True):
        truth, p = pair.assignment(), p.clamp(LEAST_PROBABILITY, 1 - 1e-7)  # close to 1, within single precision
        losses.append(-(truth * p.log() + (1 - truth) * torch.log1p(-p)).mean())
    return torch.stack(losses).mean()


@torch.no_grad()
def evaluate(network: PaperNetwork, pairs: Sequence[PaperPair]) -> tuple[float, float]:
    """Returns the loss and the share of matched S nodes whose assignment is right."""
    network.eval()
    loss, right, all_of = 0.0, 0, 0
    for first in range(0, len(pairs), EVALUATED_AT_ONCE):
        batch = pairs[first : first + EVALUATED_AT_ONCE]
        soft = network([p.a for p in batch], [p.s for p in batch])
        loss += permutation_loss(soft, batch).item() * len(batch)
        for p, pair in zip(soft, batch, strict=True):
            a, s = linear_sum_assignment(p.numpy(), maximize=True)
            right += int((pair.match[s] == a).sum())
            all_of += int((pair.match >= 0).sum())
    return loss / max(len(pairs), 1), right / max(all_of, 1)
