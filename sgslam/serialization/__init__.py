"""Serialization: the state of a run as bytes, and as a file."""

from sgslam.serialization.pickling import pack, unpack
from sgslam.serialization.state_file import read_about, read_state, write_state

__all__ = [
    "pack",
    "read_about",
    "read_state",
    "unpack",
    "write_state",
]
