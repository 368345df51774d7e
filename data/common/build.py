"""Identifies the installed build: its version and a hash of its content."""

import importlib.metadata as metadata
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path

PACKAGES = ("data", "matching", "factors", "sgslam", "evaluation")


@lru_cache(maxsize=1)
def build() -> str:
    """Returns version and hash, as `0.1.0 (1a2b3c4d)`. Machines with the same value run the same code and weights.

    The version of a checkout alone says little, since it stays the same while the code changes.
    """
    here, digest = Path(__file__).resolve().parents[2], blake2b(digest_size=4)
    for package in PACKAGES:
        for path in sorted((here / package).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith("."):
                digest.update(path.relative_to(here).as_posix().encode() + b"\0" + path.read_bytes())
    try:
        version = metadata.version("sgslam")
    except metadata.PackageNotFoundError:
        version = "not installed"
    return f"{version} ({digest.hexdigest()})"
