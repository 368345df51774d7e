"""The networks that `matching.train` trains: ours, and relatives of it by others' ideas on the same features.

All have `encode(GraphTensors)`, `forward(s, a, pairs) -> Output` and `to_dict()`, so that data, loss, loop and files
are the same.
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
    """An untrained network of a size."""
    if isinstance(settings, PcaGmSettings):
        return PcaGm(settings)
    return SuperGlue(settings) if isinstance(settings, SuperGlueSettings) else MatchingNetwork(settings)


def kind_of(network: Network) -> str:
    """The name under which it is trained and kept."""
    return "learned" if isinstance(network, MatchingNetwork) else network.kind


def settings_of(kind: str, value: dict[str, Any] | None = None) -> AnySettings:
    """The settings of a kind, as `to_dict` gave them; as they are by themselves where there are none.

    Raises UserError for a kind that does not exist, TypeError for settings that are of another.
    """
    if kind not in KINDS:
        raise UserError(f"no network '{kind}'; there are: {', '.join(KINDS)}")
    return KINDS[kind](**(value or {}))
