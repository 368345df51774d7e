"""Network files: settings and weights in half precision. Reading them runs no code from the file.

The suffix gives the format: `.npz` for the learned network (`weights_file`), torch's own format for all others.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data.common.errors import UserError
from data.common.files import write_atomically
from matching.learned.weights_file import SUFFIX, read_learned, write_learned
from matching.network.dimensions import LARGEST
from matching.network.network import MatchingNetwork
from matching.network.registry import Network, kind_of, network_of, settings_of

VERSION = 2


def save_network(path: Path, network: Network) -> None:
    """Writes a network atomically. Raises ValueError for a baseline with the suffix `.npz`."""
    state = {k: v.detach().cpu().half() for k, v in network.state_dict().items()}
    if path.suffix != SUFFIX:
        write_weights(path, _version(kind_of(network)), network.to_dict(), state)
    elif isinstance(network, MatchingNetwork):
        write_learned(path, network.to_dict(), {k: v.numpy() for k, v in state.items()})
    else:
        raise ValueError(f"{path}: only the learned network has this format")


def load_network(path: Path, kind: str = "learned") -> Network:
    """Reads a network in single precision, ready for inference.

    Raises UserError if the file is missing or does not hold a network of this kind and version.
    """
    settings, state = _read(path, kind)
    try:
        if not all(type(value) in (int, float) and 0 <= value <= LARGEST for value in settings.values()):
            raise TypeError("a setting is out of all bounds")
        with torch.device("meta"):  # takes no memory: first check the settings against the weights
            wanted = {k: v.shape for k, v in network_of(settings_of(kind, settings)).state_dict().items()}
        if wanted != {k: v.shape for k, v in state.items()}:
            raise TypeError("the weights are of another network")
        if not all(v.isfinite().all() for v in state.values()):
            raise ValueError("weights are not finite")
        network = network_of(settings_of(kind, settings))
        network.load_state_dict({k: v.float() for k, v in state.items()}, strict=True)
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError):
        raise UserError(f"{path}: its network does not fit this program; train it again") from None
    return network.eval().requires_grad_(False)


def _read(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    if path.suffix != SUFFIX:
        return read_weights(path, _version(kind), "python -m matching.train")
    settings, state = read_learned(path)
    return {**settings}, {k: torch.from_numpy(v) for k, v in state.items()}


def _version(kind: str) -> int | str:
    return VERSION if kind == "learned" else f"{kind} {VERSION}"


def write_weights(path: Path, version: int | str, settings: Mapping[str, Any], state: Mapping[str, Tensor]) -> None:
    """Writes settings and weights of any network atomically."""
    kept = {k: v.detach().cpu() for k, v in state.items()}
    buffer = io.BytesIO()
    torch.save({"version": version, "settings": dict(settings), "state": kept}, buffer)
    write_atomically(path, buffer.getvalue())


def read_weights(path: Path, version: int | str, maker: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Returns settings and weights from a file written by the command `maker`.

    Raises UserError if the file is missing, is not a network file, or has another version.
    """
    try:
        value = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a network's file (.pt)") from None
    except Exception:  # torch's reader runs no code from the file, but may raise anything
        raise UserError(f"{path}: not a network's file; '{maker}' writes one") from None
    try:
        found, settings, state = value["version"], dict(value["settings"]), dict(value["state"])
    except (KeyError, TypeError, ValueError, IndexError):
        raise UserError(f"{path}: its network does not fit this program; train it again") from None
    if found != version:
        raise UserError(f"{path}: a network of version {found}, not {version}; train it again")
    return settings, state
