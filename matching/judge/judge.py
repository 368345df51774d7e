"""`Judge`: the network that judges placements, in numpy; `matching.training.judge` trains it.

A network on sets (M. Zaheer et al.: Deep Sets, 2017): each token passes a small network, the sums and means over each
placement's tokens, with its features, another. The result is added to the log odds that the evidence gives. A softmax
over all placements and "none of them", whose log odds are 0, gives the probabilities.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from data.common.errors import UserError
from data.geometry.se2 import Array
from matching.engine.hypotheses import Hypotheses
from matching.engine.verdict import Signs
from matching.judge.placements import PLACEMENT, SKIPPED, TOKEN, Placements, placements_of

SHIPPED = Path(__file__).parents[1] / "weights" / "judge.safetensors"
SPREAD = 3.0  # by which sums over tokens are divided, beside the root of their number


@dataclass(frozen=True)
class Judge:
    """The weights (N, ...) by name, of N networks whose log odds are averaged."""

    weights: dict[str, NDArray[np.float32]]

    @staticmethod
    def load(path: Path | str | None = None) -> "Judge":
        """Reads a judge, or the one that comes with the package. Raises UserError if it cannot be read."""
        from safetensors import SafetensorError, safe_open

        file = Path(path or SHIPPED)
        try:
            with safe_open(file, "numpy") as stored:  # type: ignore[no-untyped-call]
                weights = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118, it is no mapping
        except OSError as error:
            raise UserError(f"{file}: cannot be read ({error.strerror or error}); give a judge's weights") from None
        except (SafetensorError, TypeError, ValueError) as error:
            raise UserError(f"{file}: no weights of a judge ({error})") from None
        sizes = weights["token_1.bias"].shape if "token_1.bias" in weights else ()
        if len(sizes) != 2 or {name: value.shape for name, value in weights.items()} != shapes(*sizes):
            raise UserError(f"{file}: of another network or version; python -m matching.train writes a judge")
        return Judge(weights)

    def __call__(self, found: Hypotheses, signs: Signs) -> Array:
        """(K,) the probability of each hypothesis, the likeliest first by evidence; what lacks to 1 is that of none.

        What the evidence leaves to hypotheses beyond the judged ones stays theirs.
        """
        placements = placements_of(found, signs)
        *likely, none = softmax([*self.logits(placements), 0.0])
        rest = len(signs.evidence) - len(placements)
        others = np.full(rest, (1.0 - none) * placements.unlisted / max(rest, 1))
        return np.concatenate((np.array(likely) * (1.0 - placements.unlisted), others))

    def logits(self, placements: Placements) -> Array:
        """(K,) log odds of each placement against none."""
        x = self._layer("token_2", np.maximum(self._layer("token_1", placements.tokens), 0.0))
        first = np.arange(len(placements))[:, None] == placements.of
        count = np.maximum(first.sum(axis=1, keepdims=True), 1)
        total = first.astype(np.float32) @ x
        features = self._layer("features", placements.features)
        pooled = np.concatenate((total / np.sqrt(count) / SPREAD, total / count, features), axis=-1)
        head = self._layer("head_2", np.maximum(self._layer("head_1", pooled), 0.0))[..., 0]
        by_evidence = self.weights["skip"] @ placements.features[:, :SKIPPED].T
        return np.asarray((head + by_evidence).mean(axis=0), dtype=np.float64)

    def _layer(self, name: str, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, rows, out) of rows (rows, in), the same for all networks, or (N, rows, in)."""
        weight, bias = self.weights[f"{name}.weight"], self.weights[f"{name}.bias"]
        return np.asarray(x @ np.swapaxes(weight, 1, 2) + bias[:, None], dtype=np.float32)


def shapes(count: int, width: int) -> dict[str, tuple[int, ...]]:
    """The shapes of all weights by their names, of `count` networks whose layers are so wide."""
    found: dict[str, tuple[int, ...]] = {"skip": (count, SKIPPED)}
    for name, size in (
        ("token_1", (width, len(TOKEN))), ("token_2", (width, width)), ("features", (width, len(PLACEMENT))),
        ("head_1", (width, 3 * width)), ("head_2", (1, width)),
    ):  # fmt: skip
        found |= {f"{name}.weight": (count, *size), f"{name}.bias": (count, size[0])}
    return found
