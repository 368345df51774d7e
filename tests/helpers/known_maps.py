"""A map with known true matches in a file: one drawn from a plan stands for that of a published system."""

import json
from pathlib import Path

import numpy as np

from data import SceneGraph
from data.synthetic_maps.noise_models import draw


def write_known_map(path: Path, plan: SceneGraph, rooms: int) -> Path:
    """A map of so many rooms of the plan."""
    drawn = draw(plan, "real", np.random.default_rng(2), rooms)
    matches = {"rooms": [*drawn.rooms.items()], "wall_surfaces": [*drawn.wall_surfaces.items()]}
    path.write_text(json.dumps({"s_graph": drawn.s_graph.to_dict(), "a_graph": plan.to_dict(), "matches": matches}))
    return path
