"""Proper motions of the plane; their home is `data.geometry.se2`."""

from data.geometry.se2 import Array, apply, compose, inverse, rotate, wrap

__all__ = ["Array", "apply", "compose", "inverse", "rotate", "wrap"]
