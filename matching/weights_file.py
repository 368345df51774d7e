"""A network's file: its settings and its weights in half precision, nothing that runs code when it is read."""

import io
import pickle
from pathlib import Path

import torch

from data.errors import UserError
from data.files import write_atomically
from matching.network import MatchingNetwork, Settings

VERSION = 1


def save_network(path: Path, network: MatchingNetwork) -> None:
    """Writes the network atomically."""
    state = {k: v.detach().cpu().half() for k, v in network.state_dict().items()}
    buffer = io.BytesIO()
    torch.save({"version": VERSION, "settings": network.to_dict(), "state": state}, buffer)
    write_atomically(path, buffer.getvalue())


def load_network(path: Path) -> MatchingNetwork:
    """The network of a file, in single precision, ready to be asked.

    Raises UserError where the file is missing or is not a network of this program.
    """
    try:
        value = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a network's file (.pt)") from None
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError):
        raise UserError(f"{path}: not a network's file; 'python -m matching.train' writes one") from None
    try:
        if value["version"] != VERSION:
            raise UserError(f"{path}: a network of version {value['version']}, not {VERSION}; train it again")
        network = MatchingNetwork(Settings(**value["settings"]))
        network.load_state_dict({k: v.float() for k, v in value["state"].items()}, strict=True)
    except (KeyError, TypeError, AttributeError, RuntimeError):
        raise UserError(f"{path}: its network does not fit this program; train it again") from None
    return network.eval().requires_grad_(False)
