"""A map that was recorded mirrored, or by a sensor that hangs upside down, is found out by the plan."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, box, flat, moved

from data import SceneGraph
from data.scene_graph.motion import mirrored
from matching import Matcher
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.place_verification import Plan
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene

FLAT = a_graph(flat(np.random.default_rng(0)))
SYMMETRIC = a_graph([box(-9, 0, 4, 5), box(-4, 0, 8, 5), box(5, 0, 4, 5)])


def rejection(plan: SceneGraph, mirror: bool, seed: int) -> str:
    """Why a map of the plan is rejected, whose walls are off by two centimetres; empty where it is not."""
    rng, matcher = np.random.default_rng(seed), Matcher.load()
    walls = []
    for wall in plan.wall_surfaces:
        x, y = (np.array(wall.centroid) + rng.normal(0, 0.02, 2)).tolist()
        walls.append(replace(wall, centroid=(x, y)))
    seen = moved(replace(plan, frame="map", wall_surfaces=tuple(walls)), 0.7, 3.0, -2.0)
    seen = mirrored(seen) if mirror else seen
    matching = FloorMatching(Plan(plan), matcher, AnchorSettings())
    matching.match = matcher.match(seen, plan)
    matching.reject_mirrored(Scene(seen, {}, [], {}))
    return matching.rejection


@pytest.mark.parametrize("seed", range(2))
def test_a_mirrored_map_is_told_from_a_right_one_unless_the_building_is_symmetric(seed: int) -> None:
    assert rejection(FLAT, False, seed) == "" and "mirror" in rejection(FLAT, True, seed)
    assert rejection(SYMMETRIC, False, seed) == ""
