"""The learned and the voting matcher on real plans and a real SLAM map; skipped without the shared folder."""

import itertools
import json

import numpy as np
import pytest
from methods import matcher
from plans import SHARED, moved, swiss

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.noise_models import draw

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not SHARED.is_dir(), reason=f"no folder of real plans at {SHARED}"),
]


@pytest.fixture(params=["learned", "voting"])
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_all_parts_of_a_map_that_a_published_system_built(method):
    value = json.loads((SHARED / "data/slam_graphs/SE2.json").read_text())
    whole, plan = (SceneGraph.from_dict(value[of]) for of in ("s_graph", "a_graph"))
    truth = {tuple(p) for p in value["matches"]["rooms"] + value["matches"]["wall_surfaces"]}
    rng = np.random.default_rng(0)
    unique, parts = 0, [c for k in range(2, 7) for c in itertools.combinations(whole.rooms, k)]
    for rooms in parts:
        ids = {r.id for r in rooms}
        part = SceneGraph("map", rooms, tuple(w for w in whole.wall_surfaces if w.room in ids))
        result = matcher(method).match(moved(part, rng.uniform(-np.pi, np.pi), *rng.uniform(-20, 20, 2)), plan)
        found = {(s, a) for s, a, _ in (*result.rooms, *result.wall_surfaces)}
        seen = ids | {w.id for w in part.wall_surfaces}
        assert found == {p for p in truth if p[0] in seen}
        unique += result.status == "unique"
    assert unique >= 0.95 * len(parts)


def test_real_floors_with_the_noise_of_real_scans(method):
    names = sorted(p.stem for p in (SHARED / "data/floorplans/swiss_floors").glob("*.json"))
    plans = {name: swiss(name) for name in names}
    unique = right = 0
    for n, name in enumerate(names):
        truth = draw(plans[name], "real", np.random.default_rng(n), 6)
        result = matcher(method).match(truth.s_graph, plans[name])
        centre = truth.s_graph.centroid()
        T_a_s = np.array(result.hypotheses[0].T_a_s)
        off = np.hypot(*(se2.apply(T_a_s, centre) - se2.apply(np.array(truth.T_a_s), centre)))
        right += bool(off < 0.5)
        if result.status == "unique":
            unique += 1
            assert off < 0.5
            assert {(s, a) for s, a, _ in result.rooms} <= set(truth.rooms.items())
        elsewhere = names[(n + 4) % len(names)]
        assert matcher(method).match(truth.s_graph, plans[elsewhere]).status != "unique", (name, elsewhere)
    assert unique >= 0.9 * len(names) and right >= 0.9 * len(names)


@pytest.mark.long
def test_a_storey_among_the_storeys_of_an_office_building_with_equal_offices(method):
    from data.plans import load_bim

    loaded = load_bim(SHARED / "data/ifc/AC11-Institute-Var-2-IFC.ifc")
    office = load_bim(SHARED / "data/ifc/Office_A_20110811.ifc").graph
    floor = next(f.id for f in loaded.graph.floors if f.elevation == 0)
    unique = 0
    for seed in range(6):
        truth = draw(loaded.graph.on_floor(floor), "real", np.random.default_rng(seed), 9)
        result = matcher(method).match(truth.s_graph, loaded.graph)
        if result.status == "unique":
            unique += 1
            assert result.floor == floor
            assert {(s, a) for s, a, _ in result.rooms} <= set(truth.rooms.items())
        assert matcher(method).match(truth.s_graph, office).status != "unique"
    assert unique >= 4
