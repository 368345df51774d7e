"""Confidences: what they are of a map that is in the plan, of one that is not, and of rooms that are of two."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, flat

from data.synthetic_maps.noise_models import draw
from evaluation.metrics.calibration import binned, calibration_error
from matching import Matcher

pytestmark = pytest.mark.slow

MATCHER = Matcher.load("learned")
PLANS = [a_graph(flat(np.random.default_rng(seed))) for seed in range(20, 25)]


def test_confidences_are_probabilities_whether_the_map_is_in_the_plan_or_not() -> None:
    value, right = [], []
    for n, plan in enumerate(PLANS):
        for noise in ("real", "drift", "mis_segmented"):
            drawn = draw(plan, noise, np.random.default_rng(n), 5)
            own, other = MATCHER.match(drawn.s_graph, plan), MATCHER.match(drawn.s_graph, PLANS[n - 1])
            for result in (own, other):
                value += [c for _, _, c in result.wall_surfaces]
                right += [result is own and drawn.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces]
    error = calibration_error(binned(value, right))
    assert len(value) > 400 and 0.3 < np.mean(right) < 0.8
    assert error is not None and error < 0.1


def test_a_merged_room_is_unmatched_but_its_walls_are_not() -> None:
    plan = PLANS[0]
    drawn = draw(plan, "real", np.random.default_rng(3), 7)
    whole = MATCHER.match(drawn.s_graph, plan)
    assert {(s, a) for s, a, _ in whole.rooms} == set(drawn.rooms.items())
    size = {r.id: len(drawn.s_graph.surfaces_of_room[r.id]) for r in drawn.s_graph.rooms}
    one, two = sorted(size, key=lambda r: (-size[r], r))[:2]  # as if the wall between them had not been seen
    rooms = tuple(r for r in drawn.s_graph.rooms if r.id != two)
    walls = tuple(replace(w, room=one) if w.room == two else w for w in drawn.s_graph.wall_surfaces)
    merged = MATCHER.match(replace(drawn.s_graph, rooms=rooms, wall_surfaces=walls, doors=()), plan)
    assert merged.status == "unique"
    assert one not in {s for s, _, _ in merged.rooms} and len(merged.rooms) == len(rooms) - 1
    answered = {s: a for s, a, _ in merged.wall_surfaces}
    of_both = [w.id for w in walls if w.room == one and w.id in drawn.wall_surfaces]
    assert np.mean([answered.get(w) == drawn.wall_surfaces[w] for w in of_both]) > 0.8
