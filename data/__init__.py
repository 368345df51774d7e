"""Input data as plain types: scans, IFC models, plans, and the scene graph.

The scene graph's names are loaded on first use, so that a command's `--help` answers at once.
"""

import importlib
from typing import TYPE_CHECKING

from data.common.errors import UserError

if TYPE_CHECKING:
    from data.scene_graph import Door, Floor, Keyframe, LevelSurface, Room, SceneGraph, WallSurface

__all__ = ["Door", "Floor", "Keyframe", "LevelSurface", "Room", "SceneGraph", "UserError", "WallSurface"]

if not TYPE_CHECKING:  # a type checker that sees __getattr__ takes every name for Any

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module 'data' has no attribute '{name}'")
        return getattr(importlib.import_module("data.scene_graph"), name)

    def __dir__() -> list[str]:
        return sorted(__all__)
