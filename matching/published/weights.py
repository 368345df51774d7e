"""Files of the published matcher's network, and the shipped ones by preset."""

from pathlib import Path

from data.common.errors import UserError
from matching.learned.torch_weights import read_weights, write_weights
from matching.published.network import PRESETS, PaperNetwork, PaperSettings

VERSION = "paper 1"
MAKER = "python -m matching.published.train"
SHIPPED = Path(__file__).parents[1] / "weights"


def save_paper_network(path: Path, network: PaperNetwork) -> None:
    """Writes the network atomically, in single precision, since it depends on exact lengths."""
    write_weights(path, VERSION, network.settings.to_dict(), network.state_dict())


def load_paper_network(weights: Path | str) -> PaperNetwork:
    """Reads a network from a file, or the shipped one of a preset (`published`, `repository`), ready for inference.

    Raises UserError if the file is missing or does not hold such a network.
    """
    path = SHIPPED / f"paper_{weights}.pt" if weights in PRESETS else Path(weights)
    settings, state = read_weights(path, VERSION, MAKER)
    try:
        network = PaperNetwork(PaperSettings.from_dict(settings))
        network.load_state_dict(state, strict=True)
    except (KeyError, TypeError, AttributeError, RuntimeError):
        raise UserError(f"{path}: its network does not fit this program; train it again") from None
    return network.eval().requires_grad_(False)
