"""Identifies the installed build: its version and a hash of its content."""

import importlib.metadata as metadata
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path

PRODUCT = ("data", "matching", "factors", "sgslam")
PACKAGES = (*PRODUCT, "evaluation")


@lru_cache(maxsize=1)
def build() -> str:
    """Returns version and hash, as `0.1.0 (1a2b3c4d)`. Machines with the same value run the same code and weights.

    The version of a checkout alone says little, since it stays the same while the code changes.
    """
    try:
        version = metadata.version("sgslam")
    except metadata.PackageNotFoundError:
        version = "not installed"
    return f"{version} ({content_hash(PACKAGES)})"


@lru_cache(maxsize=8)
def content_hash(packages: tuple[str, ...] = PRODUCT) -> str:
    """The hash of all files of the packages, 8 hexadecimal digits; by default of those whose results are measured."""
    here, digest = Path(__file__).resolve().parents[2], blake2b(digest_size=4)
    for package in packages:
        for path in sorted((here / package).rglob("*")):
            inside = path.relative_to(here)
            if path.is_file() and "__pycache__" not in inside.parts and not path.name.startswith("."):
                digest.update(inside.as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
