"""A map that was recorded mirrored, or by a sensor that hangs upside down, is found out by the plan."""

import numpy as np
import pytest
from plans import a_graph, box, flat, merged, moved

from data import SceneGraph
from data.scene_graph.motion import mirrored
from matching import Matcher
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.place_verification import Plan
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene

FLAT = a_graph(flat(np.random.default_rng(0)))
SYMMETRIC = merged(*(a_graph([box(x, 0, w, d)], prefix=f"{x}") for x, w, d in ((-9, 4, 5), (-4, 8, 5), (5, 4, 5))))


def as_seen(plan: SceneGraph, seed: int) -> SceneGraph:
    """The plan from a map's frame, with walls off by two centimetres."""
    rng = np.random.default_rng(seed)
    noisy = [(w.centroid[0] + rng.normal(0, 0.02), w.centroid[1] + rng.normal(0, 0.02)) for w in plan.wall_surfaces]
    walls = tuple(type(w)(w.id, w.room, c, w.normal, w.length) for w, c in zip(plan.wall_surfaces, noisy, strict=True))
    return moved(SceneGraph("map", plan.rooms, walls, plan.doors), 0.7, 3.0, -2.0)


def judged(plan: SceneGraph, seen: SceneGraph) -> FloorMatching:
    matcher = Matcher.load()
    matching = FloorMatching(Plan(plan), matcher, AnchorSettings())
    matching.match = matcher.match(seen, plan)
    matching.reject_mirrored(Scene(seen, {}, [], {}))
    return matching


@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_map_is_told_from_a_right_one(seed: int) -> None:
    seen = as_seen(FLAT, seed)
    assert judged(FLAT, seen).rejection == ""
    assert "mirror" in judged(FLAT, mirrored(seen)).rejection


@pytest.mark.parametrize("seed", range(3))
def test_a_symmetric_building_is_its_own_mirror_image(seed: int) -> None:
    assert judged(SYMMETRIC, as_seen(SYMMETRIC, seed)).rejection == ""


def test_the_mirror_image_of_a_mirror_image_is_the_graph() -> None:
    image = mirrored(FLAT)
    assert mirrored(image) == FLAT and image != FLAT
    left, right = image.wall_surfaces[0].ends()
    ends = [(x, -y) for x, y in FLAT.wall_surfaces[0].ends()]
    np.testing.assert_allclose([right, left], ends, atol=1e-9)  # the left end is the other one
