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
    """The `probability` that the map is at the best place, on `storey`, and sound; that of the `runner_up`; those that
    it is at none of the places (`outside`), recorded `mirrored`, or not `sound`.

    `signals` and `nats` are what tells whether the map is sound, and the log likelihood ratios in favour. `T_bim_map`
    (4, 4) is the place, if the map was anchored there, until it proved improbable too.
    """

    probability: float
    storey: str | None
    runner_up: float
    runner_up_storey: str | None
    outside: float
    mirrored: float
    sound: float = 1.0
    signals: Mapping[str, float] = field(default_factory=dict)
    nats: Mapping[str, float] = field(default_factory=dict)
    T_bim_map: Floats | None = None

    @staticmethod
    def of(
        posterior: PlacePosterior, sound: Soundness | None = None, signals: Mapping[str, float] | None = None,
        T_bim_map: Floats | None = None,
    ) -> "PlaceReport":  # fmt: skip
        """Of a posterior, and of the soundness of the map at its best place."""
        places = [(place.probability, place.floor) for place in posterior.places[:2]]
        (best, storey), (other, other_storey) = [*places, *2 * [(0.0, None)]][:2]
        likely, nats = (1.0, {}) if sound is None else (sound.probability, dict(sound.nats))
        return PlaceReport(
            best * likely, storey, other, other_storey, posterior.outside, posterior.mirrored, likely,
            signals or {}, nats, T_bim_map,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        T = self.T_bim_map
        return {
            **{name: getattr(self, name) for name in ("probability", "storey", "runner_up", "runner_up_storey")},
            **{name: getattr(self, name) for name in ("outside", "mirrored", "sound")},
            "signals": {name: {"value": value, "nats": self.nats.get(name)} for name, value in self.signals.items()},
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
        }
