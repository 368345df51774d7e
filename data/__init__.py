"""Input data as plain types: scans, IFC models, plans, and the scene graph."""

from data.common.errors import UserError
from data.scene_graph import Door, Floor, Keyframe, Room, SceneGraph, WallSurface

__all__ = ["Door", "Floor", "Keyframe", "Room", "SceneGraph", "UserError", "WallSurface"]
