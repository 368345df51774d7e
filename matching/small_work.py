"""Torch at its smallest: whether it works here, and a network's file to try readers on."""

from pathlib import Path

import torch

from matching.networks import network_of, settings_of
from matching.weights_file import save_network


def work() -> None:
    """Fails where torch does not work here."""
    assert float((torch.eye(3) @ torch.ones(3)).sum()) == 3


def write_small_network(path: Path) -> None:
    """A network with more form than weights, always the same; untrained."""
    torch.manual_seed(0)
    save_network(path, network_of(settings_of("learned", {"width": 8, "layers": 1, "state": 4})))
