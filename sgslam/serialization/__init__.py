"""Serialization: the state of a run as a tree of plain values, and as a file."""

from sgslam.serialization.state_file import read_about, read_state, write_state
from sgslam.serialization.state_tree import Stateful

__all__ = [
    "Stateful",
    "read_about",
    "read_state",
    "write_state",
]
