"""Serialization: the state of a run as a tree of plain values, and as a file."""
