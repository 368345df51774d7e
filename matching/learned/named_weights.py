"""A network's weights by their names in torch; names and shapes are checked as they are read."""

from collections.abc import Mapping

import numpy as np

from matching.network.arithmetic import Linear, Norm
from matching.network.features import Array32


class NamedWeights:
    """Named arrays, each of which is to be read once.

    All methods raise ValueError if the array is missing, has another shape or is not finite.
    """

    def __init__(self, state: Mapping[str, Array32]) -> None:
        self._left = dict(state)

    def array(self, name: str, *shape: int) -> Array32:
        """Returns an array by its own name."""
        found = self._left.pop(name, None)
        if found is None or found.shape != shape or not np.isfinite(found).all():
            raise ValueError(f"no numbers '{name}' of shape {shape}")
        return found

    def matrix(self, name: str, inputs: int, outputs: int) -> Array32:
        """Returns (inputs, outputs) the weight of a torch `Linear`, transposed."""
        return np.ascontiguousarray(self.array(f"{name}.weight", outputs, inputs).T)

    def linear(self, name: str, inputs: int, outputs: int) -> Linear:
        """Returns the weights of a torch `Linear`."""
        return Linear(self.matrix(name, inputs, outputs), self.array(f"{name}.bias", outputs))

    def norm(self, name: str, width: int) -> Norm:
        """Returns the weights of a torch `LayerNorm`."""
        return Norm(self.array(f"{name}.weight", width), self.array(f"{name}.bias", width))

    def end(self) -> None:
        """Raises ValueError if arrays are left that were not read."""
        if self._left:
            raise ValueError(f"numbers of another network: {', '.join(self._left)}")
