"""A network's weights by the names that torch gives them: who asks for one says its shape, and that is how a file's
names and shapes are checked."""

from collections.abc import Mapping

import numpy as np

from matching.network.arithmetic import Linear, Norm
from matching.network.features import Array32


class NamedWeights:
    """Each array is asked for once. All raise ValueError for one that is missing, of another shape or not finite."""

    def __init__(self, state: Mapping[str, Array32]) -> None:
        self._left = dict(state)

    def array(self, name: str, *shape: int) -> Array32:
        """By its own name."""
        found = self._left.pop(name, None)
        if found is None or found.shape != shape or not np.isfinite(found).all():
            raise ValueError(f"no numbers '{name}' of shape {shape}")
        return found

    def matrix(self, name: str, inputs: int, outputs: int) -> Array32:
        """(inputs, outputs) the weight of a torch `Linear`, which keeps it the other way round."""
        return np.ascontiguousarray(self.array(f"{name}.weight", outputs, inputs).T)

    def linear(self, name: str, inputs: int, outputs: int) -> Linear:
        """The weights of a torch `Linear`."""
        return Linear(self.matrix(name, inputs, outputs), self.array(f"{name}.bias", outputs))

    def norm(self, name: str, width: int) -> Norm:
        """The weights of a torch `LayerNorm`."""
        return Norm(self.array(f"{name}.weight", width), self.array(f"{name}.bias", width))

    def end(self) -> None:
        """Raises ValueError where there is more than was asked for."""
        if self._left:
            raise ValueError(f"numbers of another network: {', '.join(self._left)}")
