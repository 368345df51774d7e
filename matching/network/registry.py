"""The networks that `matching.train` trains: the project's own and two baselines on the same features.

All have `encode(GraphTensors)`, `forward(s, a, pairs) -> Output` and `to_dict()`, so that data, loss, training loop and
files are shared.
"""

from typing import Any

from data.common.errors import UserError
from matching.network.dimensions import Settings
from matching.network.network import MatchingNetwork
from matching.network.pca_gm import PcaGm, PcaGmSettings
from matching.network.superglue import SuperGlue, SuperGlueSettings

Network = MatchingNetwork | PcaGm | SuperGlue
AnySettings = Settings | PcaGmSettings | SuperGlueSettings
KINDS: dict[str, type[AnySettings]] = {
    "learned": Settings, PcaGm.kind: PcaGmSettings, SuperGlue.kind: SuperGlueSettings
}  # fmt: skip


def network_of(settings: AnySettings) -> Network:
    """Creates an untrained network."""
    if isinstance(settings, PcaGmSettings):
        return PcaGm(settings)
    return SuperGlue(settings) if isinstance(settings, SuperGlueSettings) else MatchingNetwork(settings)


def kind_of(network: Network) -> str:
    """The name of a network's kind, as in `matching.train --network`."""
    return "learned" if isinstance(network, MatchingNetwork) else network.kind


def settings_of(kind: str, value: dict[str, Any] | None = None) -> AnySettings:
    """Returns the settings of a kind from `to_dict`, or its defaults.

    Raises UserError for an unknown kind, TypeError for settings of another kind.
    """
    if kind not in KINDS:
        raise UserError(f"no network '{kind}'; there are: {', '.join(KINDS)}")
    return KINDS[kind](**(value or {}))
