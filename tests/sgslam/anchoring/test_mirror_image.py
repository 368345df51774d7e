"""A map that was recorded mirrored, or by a sensor that hangs upside down, is found out by the plan."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, box, flat, moved

from data import SceneGraph
from data.scene_graph.graph import mirrored
from matching import Matcher
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.plan import Plan
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene

FLAT = a_graph(flat(np.random.default_rng(0)))
SYMMETRIC = a_graph([box(-9, 0, 4, 5), box(-4, 0, 8, 5), box(5, 0, 4, 5)])


def asked(plan: SceneGraph, mirror: bool, seed: int) -> FloorMatching:
    """About a map of the plan, whose walls are off by two centimetres."""
    rng, walls = np.random.default_rng(seed), []
    for wall in plan.wall_surfaces:
        x, y = (np.array(wall.centroid) + rng.normal(0, 0.02, 2)).tolist()
        walls.append(replace(wall, centroid=(x, y)))
    seen = moved(replace(plan, frame="map", wall_surfaces=tuple(walls)), 0.7, 3.0, -2.0)
    matching = FloorMatching(Plan(plan), Matcher.load(), AnchorSettings())
    matching.ask(Scene(mirrored(seen) if mirror else seen, {}, [], {}), last=True)
    return matching


@pytest.mark.parametrize("seed", range(2))
def test_a_mirrored_map_is_told_from_a_right_one_unless_the_building_is_symmetric(seed: int) -> None:
    right, wrong = (asked(FLAT, mirror, seed) for mirror in (False, True))
    assert right.is_sure and "mirror" not in right.reason and right.posterior.mirrored < 1e-6
    assert not wrong.is_sure and "mirror" in wrong.reason and wrong.posterior.mirrored > 0.9
    assert all("mirror" not in asked(SYMMETRIC, mirror, seed).reason for mirror in (False, True))
