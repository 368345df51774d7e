"""What a run believes of the map's place in the plan, as in metrics.json."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.geometry.poses import poses_to_xyzquat
from sgslam.anchoring.place_posterior import PlacePosterior
from sgslam.anchoring.soundness import Soundness

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlaceReport:
    """What is known of the places, whether the map is `sound` at the best one, and the `signals` that tell.

    `T_bim_map` (4, 4) is that place, if the map was anchored there, until it proved improbable too.
    """

    posterior: PlacePosterior
    sound: Soundness = field(default_factory=lambda: Soundness(1.0, {}))
    signals: Mapping[str, float] = field(default_factory=dict)
    T_bim_map: Floats | None = None

    @property
    def probability(self) -> float:
        """That the map is at the best place and sound."""
        return self.posterior.two_best[0][0] * self.sound.probability

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, with the `outside` probability that the map is at none of the places."""
        (_, storey), (runner_up, runner_up_storey) = self.posterior.two_best
        T, nats = self.T_bim_map, self.sound.nats
        return {
            "probability": self.probability,
            "storey": storey,
            "runner_up": runner_up,
            "runner_up_storey": runner_up_storey,
            "outside": self.posterior.outside,
            "mirrored": self.posterior.mirrored,
            "sound": self.sound.probability,
            "signals": {name: {"value": value, "nats": nats.get(name)} for name, value in self.signals.items()},
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
        }
