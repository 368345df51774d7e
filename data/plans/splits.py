"""Which plans are for training, validation and test."""

import hashlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

Split = Literal["train", "validation", "test"]

SHARES: Mapping[Split, float] = MappingProxyType({"train": 0.7, "validation": 0.15, "test": 0.15})


def split_of(building: str, seed: int = 0) -> Split:
    """The split of all plans of a building, by a hash of its name: the same on every machine."""
    digest = hashlib.sha256(f"{seed}:{building}".encode()).digest()
    at = int.from_bytes(digest[:8], "big") / 2**64
    for split, share in SHARES.items():
        if at < share:
            return split
        at -= share
    return "test"
