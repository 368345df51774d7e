"""Files of the published matcher's network, and the shipped ones by preset."""

import io
from pathlib import Path

import torch

from data.common.errors import UserError
from data.common.files import write_atomically
from matching.published.network import PRESETS, PaperNetwork, PaperSettings

VERSION = "paper 1"
MAKER = "python -m matching.published.train"
SHIPPED = Path(__file__).parents[1] / "weights"


def save_paper_network(path: Path, network: PaperNetwork) -> None:
    """Writes the network atomically, in single precision, since it depends on exact lengths."""
    state = {name: value.detach().cpu() for name, value in network.state_dict().items()}
    buffer = io.BytesIO()
    torch.save({"version": VERSION, "settings": network.settings.to_dict(), "state": state}, buffer)
    write_atomically(path, buffer.getvalue())


def load_paper_network(weights: Path | str) -> PaperNetwork:
    """Reads a network from a file, or the shipped one of a preset (`published`, `repository`), ready for inference.

    Raises UserError if the file is missing or does not hold such a network.
    """
    path = SHIPPED / f"paper_{weights}.pt" if weights in PRESETS else Path(weights)
    try:
        value = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a network's file (.pt)") from None
    except Exception:  # torch's reader runs no code from the file, but may raise anything
        raise UserError(f"{path}: not a network's file; '{MAKER}' writes one") from None
    try:
        if value["version"] != VERSION:
            raise ValueError("another version")
        network = PaperNetwork(PaperSettings.from_dict(value["settings"]))
        network.load_state_dict(value["state"], strict=True)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RuntimeError):
        raise UserError(f"{path}: its network does not fit this program; train it again") from None
    return network.eval().requires_grad_(False)
