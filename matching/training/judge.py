"""The judge's network in PyTorch, its loss, loop, calibration and files; `matching.judge` runs it in numpy."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from data.common.files import atomic_file, write_atomically
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.judge.judge import SPREAD, Judge
from matching.judge.placements import PLACEMENT, SKIPPED, TOKEN, Placements
from matching.training.calibrate import FOREIGN, MISLABELLED
from matching.training.judge_data import Examples

WIDTH = 64
BATCH = 64  # maps
RARE = {"foreign": FOREIGN, "mirrored": 0.002}  # probabilities beforehand; small maps fit a mirrored plan as well
RATE, WEIGHT_DECAY, WARM_UP, LAST_RATE = 2e-3, 1e-3, 100, 0.02


class JudgeNetwork(nn.Module):
    """Log odds of placements from their tokens; untrained it repeats those of the evidence."""

    def __init__(self, width: int = WIDTH) -> None:
        super().__init__()
        self.token_1, self.token_2 = nn.Linear(len(TOKEN), width), nn.Linear(width, width)
        self.features = nn.Linear(len(PLACEMENT), width)
        self.head_1, self.head_2 = nn.Linear(3 * width, width), nn.Linear(width, 1)
        self.skip = nn.Parameter(torch.ones(SKIPPED))
        nn.init.zeros_(self.head_2.weight)
        nn.init.zeros_(self.head_2.bias)

    def forward(self, tokens: Tensor, of: Tensor, features: Tensor) -> Tensor:
        """(P,) from tokens (T, len(TOKEN)) `of` (T,) placements, and features (P, len(PLACEMENT))."""
        x = self.token_2(torch.relu(self.token_1(tokens)))
        total = x.new_zeros(len(features), x.shape[1]).index_add(0, of, x)
        count = torch.bincount(of, minlength=len(features)).clamp(min=1)[:, None]
        pooled = torch.cat((total / count.sqrt() / SPREAD, total / count, self.features(features)), dim=1)
        head: Tensor = self.head_2(torch.relu(self.head_1(pooled)))[:, 0]
        return head + features[:, :SKIPPED] @ self.skip

    def of(self, examples: Examples) -> Tensor:
        """(P,) log odds of all placements of examples."""
        of = np.repeat(np.arange(len(examples.sizes)), examples.sizes)
        tokens = torch.from_numpy(examples.tokens.astype(np.float32))
        result: Tensor = self(tokens, torch.from_numpy(of), torch.from_numpy(examples.features))
        return result


def log_probabilities(log_odds: Tensor, examples: Examples) -> Tensor:
    """(M, rivals + 1) of each map's placements and, last, of none; -inf where there is no placement."""
    table = log_odds.new_full((len(examples), int(examples.rivals.max()) + 1), -math.inf)
    table[:, -1] = 0.0
    table[_cells(examples)] = log_odds
    return table.log_softmax(dim=1)


def weights_of(examples: Examples) -> Array:
    """(M,) weights by which foreign and mirrored plans are as rare as in reality."""
    regime = np.char.partition(examples.about, " ")[:, 0]
    weights, rest = np.zeros(len(examples)), ~np.isin(regime, [*RARE])
    for chosen, prior in [(rest, 1 - sum(RARE.values())), *((regime == name, of) for name, of in RARE.items())]:
        weights[chosen] = prior / max(float(chosen.mean()), 1e-9)
    return weights


def loss(log_odds: Tensor, examples: Examples, weights: Array) -> Tensor:
    """Mean negative log likelihood of what is right, with weights (M,); a few labels are wrong."""
    found = log_probabilities(log_odds, examples)
    right = torch.zeros(found.shape, dtype=torch.bool)
    right[_cells(examples)] = torch.from_numpy(examples.right)
    right[:, -1] = ~right.any(dim=1)
    known = torch.where(right, found, -math.inf).logsumexp(dim=1)
    mislabelled = torch.full_like(known, math.log(MISLABELLED))
    return -(
        torch.from_numpy(weights).to(known.dtype) * torch.logaddexp(known + math.log(1 - MISLABELLED), mislabelled)
    ).mean()


def _cells(examples: Examples) -> tuple[Tensor, Tensor]:
    """Row and column (P,) of each placement in a table of the maps' placements."""
    rows = np.repeat(np.arange(len(examples)), examples.rivals)
    first = np.repeat(np.cumsum(examples.rivals) - examples.rivals, examples.rivals)
    return torch.from_numpy(rows), torch.from_numpy(np.arange(len(rows)) - first)


@dataclass
class JudgeTraining:
    """The state of a run; step k of a seed always takes the same examples."""

    network: JudgeNetwork
    optimizer: torch.optim.Optimizer
    seed: int
    step: int = 0

    @staticmethod
    def begin(seed: int) -> "JudgeTraining":
        """An untrained network; the same for the same seed."""
        torch.manual_seed(seed)
        network = JudgeNetwork()
        return JudgeTraining(network, torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY), seed)

    def save(self, path: Path) -> None:
        """Writes the state atomically."""
        states = {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict(), "step": self.step}
        with atomic_file(path) as file:
            torch.save(states, file)

    def load(self, path: Path) -> None:
        """Resumes from a saved run."""
        stored = torch.load(path, map_location="cpu", weights_only=True)
        self.network.load_state_dict(stored["network"])
        self.optimizer.load_state_dict(stored["optimizer"])
        self.step = stored["step"]

    def train(self, examples: Examples, steps: int, every: int) -> Iterator[float]:
        """Trains until `steps` are done; yields the mean loss all `every` steps and at the end."""
        losses, weights = list[float](), weights_of(examples)
        while self.step < steps:
            rate = min(1.0, (self.step + 1) / WARM_UP) * (1 + math.cos(math.pi * self.step / steps)) / 2
            for group in self.optimizer.param_groups:
                group["lr"] = RATE * max(rate, LAST_RATE)
            chosen = np.random.default_rng([self.seed, self.step]).integers(len(examples), size=BATCH)
            batch = examples[chosen]
            value = loss(self.network.of(batch), batch, weights[chosen])
            self.optimizer.zero_grad()
            value.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
            self.optimizer.step()
            self.step += 1
            losses.append(value.item())
            if self.step % every == 0 or self.step == steps:
                yield sum(losses) / len(losses)
                losses = []


def judge_of(networks: Sequence[JudgeNetwork]) -> Judge:
    """The judge whose log odds are the means of those of networks."""
    states = [network.state_dict() for network in networks]
    return Judge({name: torch.stack([state[name] for state in states]).numpy() for name in states[0]})


def log_odds_of(judge: Judge, examples: Examples) -> Tensor:
    """(P,) of all placements."""
    begin = np.concatenate(([0], np.cumsum(examples.sizes)))
    of, first = np.repeat(np.arange(len(examples.sizes)), examples.sizes), np.cumsum(examples.rivals) - examples.rivals
    every = []
    for k, n in zip(first.tolist(), examples.rivals.tolist(), strict=True):
        own = slice(begin[k], begin[k + n])
        tokens = examples.tokens[own].astype(np.float32)
        every.append(judge.logits(Placements(tokens, of[own] - k, examples.features[k : k + n])))
    return torch.from_numpy(np.concatenate(every))


def shares(log_odds: Tensor, examples: Examples) -> Array:
    """(P,) the probabilities of all placements."""
    return log_probabilities(log_odds, examples)[_cells(examples)].exp().double().numpy()


def save_judge(path: Path, judge: Judge) -> None:
    """Writes the weights."""
    from safetensors.numpy import save

    write_atomically(path, save(dict(judge.weights)))


def measures(log_odds: Tensor, examples: Examples, sure: float = 0.99) -> dict[str, float]:
    """Of examples, with log odds (P,) and by evidence alone: the shares that are decided, and how many of these are
    wrong, of which foreign."""
    by_evidence = torch.from_numpy(examples.features[:, :SKIPPED].sum(axis=1))
    found: dict[str, float] = {"maps": len(examples), "foreign": int(examples.foreign.sum())}
    for name, each in (("judge", log_odds), ("evidence", by_evidence)):
        share = shares(each, examples)
        best = best_of(share, examples)
        decided, right = share[best] >= sure, examples.right[best]
        found |= {
            f"{name} decided": float(decided[~examples.foreign].mean()),
            f"{name} wrong": int((decided & ~right & ~examples.foreign).sum()),
            f"{name} wrong, foreign": int((decided & examples.foreign).sum()),
        }
    return found


def best_of(share: Array, examples: Examples) -> Index:
    """(M,) the most probable placement of each map."""
    first = np.cumsum(examples.rivals) - examples.rivals
    return np.array([f + int(share[f : f + n].argmax()) for f, n in zip(first, examples.rivals, strict=True)])
