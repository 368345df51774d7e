"""A drive through a building that deviates from its plan: the map keeps its place, the deviations are reported."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Array
from drives import fed, small_drive, small_run

from data import WallSurface
from sgslam.slam import SceneGraphSlam

OFF = 0.2  # m


def xy(values: Array) -> tuple[float, float]:
    x, y = values.tolist()
    return x, y


def test_a_building_as_planned_has_no_deviations_and_its_poses_are_known_as_well_as_it_says() -> None:
    drive, (_, clean) = small_drive(), small_run(with_bim=True)
    assert len(clean.deviations) >= 10 and not any(d["significant"] for d in clean.deviations)
    assert {d["kind"] for d in clean.deviations} == {"moved"} and all(d["reason"] for d in clean.deviations)
    assert all(record["events"] for record in clean.anchors)
    assert {record["by"].split()[0] for record in clean.anchors} <= {"match", "position"}
    errors = clean.trajectory.positions - drive.truth.at(clean.trajectory.stamps_ns)[:, :3, 3]
    squared = (errors / clean.uncertainty.sigma[clean.uncertainty.anchored, :3]) ** 2
    assert len(squared) > 20 and 0.1 < squared.mean() < 3.0
    held = clean.factors["anchor"]
    assert len(clean.factors["odometry"]) == clean.keyframes - 1 and len(clean.factors["wall"]) > 100
    tight = {(f"w{key[1]}", key[2]) for key in held if key[0] == "wall" and len(key) == 3}
    states = {(r["wall"], r["a_id"]): r["state"] for r in clean.anchors}
    assert len(tight) > 10 and all(states[key] == "tight" for key in tight)


@pytest.mark.slow
def test_walls_that_are_moved_missing_or_extra_are_reported_and_do_not_distort_the_map() -> None:
    """The plan has the wall between the office and the store 20 cm off and a free-standing wall along the hall, and
    lacks the hall's southern wall. It is no IFC model: walls may have windows that are not drawn."""
    drive, (_, clean) = small_drive(), small_run(with_bim=True)
    graph = drive.bim.graph
    hall, office, store = (next(r for r in graph.rooms if r.name == name) for name in ("Hall", "Office", "Store"))
    long = {w.source for w in graph.wall_surfaces if (w.length or 0.0) > 9.0}
    rooms = {s: {w.room for w in graph.wall_surfaces if w.source == s} for s in {w.source for w in graph.wall_surfaces}}
    between = next(s for s, own in rooms.items() if own == {office.id, store.id})
    south = next(s for s, own in rooms.items() if own == {hall.id, None} and s in long)
    along = np.array(next(w for w in graph.wall_surfaces if w.source == between).normal)
    step = OFF * along
    across, height = np.array([-along[1], along[0]]), graph.surfaces_of_room[hall.id][0].height
    walls = []
    for k in (-1, 1):
        middle, normal = xy(np.array(hall.centroid) + 0.06 * k * across), xy(k * across)
        walls.append(WallSurface(f"free/{k}", hall.id, middle, normal, 7.0, hall.floor, "free", height))
    for wall in (wall for wall in graph.wall_surfaces if wall.source != south):
        off = step if wall.source == between else 0.0
        walls.append(replace(wall, centroid=xy(np.array(wall.centroid) + off), plane=None))
    result = fed(SceneGraphSlam(replace(graph, wall_surfaces=tuple(walls))), drive.scans).finish()
    assert result.anchored and result.T_bim_map is not None, result.reason
    assert drive.rmse(result) < 1.5 * drive.rmse(clean) + 0.003
    found = [d for d in result.deviations if d["significant"]]
    moved, absent, extra = ([d for d in found if d["kind"] == kind] for kind in ("moved", "absent", "extra"))
    assert {d["source"] for d in moved} == {between}
    held = {record["a_id"]: record["state"] for record in result.anchors}
    for d in moved:
        true = -step @ np.array(graph.surface_by_id[d["a_id"]].normal)
        assert d["offset_m"] == pytest.approx(true, abs=0.03) and 0.003 < d["sigma_m"] < 0.05
        assert held[d["a_id"]] == "loose"
    assert sum(state == "tight" for state in held.values()) > len(moved)
    assert {d["a_id"] for d in absent} == {"free/-1", "free/1"} and {d["source"] for d in absent} == {"free"}
    stands = next(w for w in graph.wall_surfaces if w.source == south and w.room == hall.id)
    assert extra
    for d in extra:
        assert np.abs((np.array(d["trace"]) - stands.centroid) @ stands.normal).max() < 0.05
