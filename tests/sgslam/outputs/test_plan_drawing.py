"""What plan.png and the report's plan draw where, which scans they leave out, and the error against time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from report_samples import T_BIM_MAP, anchor, not_anchored, on_two_floors, sample, with_lost_scans, without_plan

from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import BANDS, band_of, deviation_text, signed_mm
from sgslam.report import ReportData
from sgslam.report.accuracy import accuracy
from sgslam.report.contents import current_storey, entered_unmatched, split_by_floor
from sgslam.report.drawn_paths import MAX_VERTICES
from sgslam.report.error_chart import chart_data, error_chart, error_lines
from sgslam.report.page import report_html
from sgslam.report.plan_drawing import plan_drawing

WHY = "the walls no longer agree"


def with_poses(data: ReportData, poses: np.ndarray) -> ReportData:
    """The run with other poses in the map frame."""
    return replace(data, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))


def shifted(data: ReportData, offsets: np.ndarray) -> ReportData:
    """The run with its map trajectory moved by `offsets` (N, 3) in the map frame."""
    poses = data.trajectory_map.poses.copy()
    poses[:, :3, 3] += offsets
    return with_poses(data, poses)


def with_states(data: ReportData, **changed: Any) -> ReportData:
    assert data.scans is not None
    return replace(data, scans=replace(data.scans, **changed))


def test_the_map_lies_on_the_plan_when_anchored() -> None:
    drawing = plan_drawing(sample())
    assert drawing.heading == "Storey 1" and drawing.floor_z == 3.5
    for ours, planned in zip(drawing.map_walls, drawing.bim_walls, strict=False):
        assert np.allclose(ours.ends, planned.ends, atol=1e-9)
    assert np.allclose(drawing.match_lines[:, 0], drawing.match_lines[:, 1], atol=1e-9)
    way, truth, odometry = (drawing.paths[name][0].points for name in ("trajectory", "truth", "odometry"))
    assert np.allclose(way, truth, atol=1e-9) and np.allclose(way[:, 2], 4.0)
    away = np.linalg.norm(odometry - truth, axis=1)
    assert away[0] < 1e-9 and away[-1] > 0.3
    assert np.allclose([w.z for w in drawing.map_walls[:36]], [3.6, 5.1])  # over the floor


def test_a_map_without_a_place_lies_beside_the_plan_or_where_it_is_guessed() -> None:
    drawing = plan_drawing(not_anchored("none"))
    assert not len(drawing.match_lines) and not any(w.matched for w in drawing.map_walls)
    right_of_plan = max(w.ends[:, 0].max() for w in drawing.bim_walls)
    assert min(w.ends[:, 0].min() for w in drawing.map_walls[:36]) > right_of_plan
    guess = plan_drawing(not_anchored("ambiguous"))
    assert np.allclose(guess.map_walls[0].ends, guess.bim_walls[0].ends, atol=1e-9)
    assert np.allclose(guess.paths["trajectory"][0].points[:, 2], 4.0)  # its floor is laid on the storey's
    assert not guess.with_deviations and plan_drawing(without_plan()).floor_z == -0.5


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, "F1"),
        ({"matches": None}, "F1"),  # by the height of the trajectory
        ({"matches": {"floor": "F0"}}, "F0"),
        ({"matches": None, "T_bim_map": None}, "F1"),  # by the height of the truth
        ({"matches": None, "T_bim_map": None, "truth": None}, "F0"),
        ({"matches": {"floor": None, "hypotheses": [{"floor": "F0"}]}, "T_bim_map": None}, "F0"),
    ],
)
def test_the_robots_storey(change: dict[str, Any], expected: str) -> None:
    floor = current_storey(replace(sample(), **change))
    assert floor is not None and floor.id == expected


def test_bands_grow_outward_on_both_sides() -> None:
    assert band_of(None) is None and len({band_of(v) for v in (0.0, 0.0099, -0.0099)}) == 1
    offsets = [-5.0, -0.1, -0.099, -0.03, -0.029, -0.01, 0.0, 0.01, 0.029, 0.03, 0.099, 0.1, 5.0]
    steps = [BANDS.index(band_of(offset) or "") for offset in offsets]
    assert steps == sorted(steps) and set(steps) == set(range(len(BANDS)))
    minus = "\N{MINUS SIGN}"
    assert [signed_mm(v) for v in (0.01234, -0.0004, -0.00004, None)] == ["+12.3 mm", f"{minus}0.4 mm", "0.0 mm", ""]
    short = {"kind": "moved", "offset_m": 0.04, "tilt_rad": None, "sigma_m": None, "significant": True}
    assert "+40.0 mm" in deviation_text(short)


def test_walls_carry_their_deviation() -> None:
    drawing = plan_drawing(replace(sample(), elements=[]))
    moved, cupboard = drawing.map_walls[5], drawing.map_walls[36]
    assert moved.band == band_of(-0.1234) and moved.significant and moved.id in moved.title
    assert "123.4 mm" in moved.title and drawing.map_walls[7].band == band_of(0.045)
    others = {w.band for i, w in enumerate(drawing.map_walls) if i not in (5, 7, 36)}
    assert others == {band_of(0.0)} and cupboard.band is None and not cupboard.matched


def test_what_strays_does_not_shrink_the_plan() -> None:
    data = sample()
    poses = data.trajectory_odometry.poses.copy()
    poses[:, :3, 3] *= 50
    stray = replace(data, trajectory_odometry=Trajectory(data.trajectory_odometry.stamps_ns, poses))
    usual = np.ptp(plan_drawing(data).bounds(), axis=0)
    for far in (stray, with_lost_scans(data)):  # whose unplaced part lies 500 m away
        assert np.ptp(plan_drawing(far).bounds(), axis=0).max() < 2 * usual.max()


def test_lost_scans_are_a_path_of_their_own_and_unplaced_parts_are_none() -> None:
    data = with_lost_scans(sample())
    assert data.truth is not None and data.scans is not None
    truth, paths = data.truth.positions, plan_drawing(data).paths
    known = np.vstack([piece.points for piece in paths["trajectory"]])
    assert np.allclose(known, truth[np.r_[0:100, 130:400, 450:500]])
    (lost,) = paths["lost"]
    assert np.allclose(lost.points, truth[99:131])  # with the known scans on either side
    before = data.scans.lost | (np.arange(500) >= 390) & (np.arange(500) < 400)
    *_, piece = plan_drawing(with_states(data, lost=before)).paths["lost"]
    assert np.allclose(piece.points, truth[389:400])  # it does not lead to a part that has no place
    assert not plan_drawing(sample()).paths.get("lost")


def test_one_lost_scan_of_a_long_run_is_seen() -> None:
    data, scans = sample(count=20_000), np.arange(20_000)
    (grey,) = plan_drawing(with_states(data, lost=scans == 12_345)).paths["lost"]
    assert 2 <= len(grey.points) <= 3 and "1234." in grey.title
    paths = plan_drawing(with_states(data, lost=scans % 20 < 10)).paths
    assert sum(len(piece.points) for kind in ("trajectory", "lost") for piece in paths[kind]) < 2.5 * MAX_VERTICES
    assert len(plan_drawing(data).paths["trajectory"][0].points) == MAX_VERTICES


def test_of_two_floors_each_has_its_own_part_of_the_way() -> None:
    for placed in (True, False):
        data = on_two_floors(placed)
        parts = split_by_floor(data)
        assert [len(part.trajectory_map) for part in parts] == [300, 200]  # between them it is on the one that was left
        unmatched = replace(data, matches={**(data.matches or {}), "rooms": []})
        found = [entered_unmatched(part) for part in split_by_floor(unmatched)]
        assert found[0] and bool(found[1]) is placed
    s_graph = data.s_graph
    below = replace(s_graph, keyframes=tuple(replace(k, floor="floor-0") for k in s_graph.keyframes))
    assert report_html(replace(data, s_graph=below)).count("<h2>") == report_html(data).count("<h2>")


def test_withdrawn_anchors_are_marked_unless_another_wall_holds_the_planned_one() -> None:
    data = sample()
    gone = ["F1 room0/0", "F1 room8/2"]
    anchors = [anchor(a["wall"], a["a_id"], WHY if a["a_id"] in gone else None) for a in data.anchors]
    withdrawn = replace(data, anchors=anchors)
    marks, walls = ({w.id: w for w in own} for own in (plan_drawing(withdrawn).withdrawn, plan_drawing(data).bim_walls))
    assert sorted(marks) == gone
    assert all(np.array_equal(marks[a_id].ends, walls[a_id].ends) for a_id in gone)
    assert WHY in report_html(withdrawn) and WHY not in report_html(data)
    for other in ("F1 room0/0", "F0 room0/0"):  # anchored again; on another storey
        assert not plan_drawing(replace(data, anchors=[anchor("w99", other, WHY), *data.anchors])).withdrawn


def band(data: ReportData, x: float, y: float) -> shapely.Geometry:
    """What is drawn of the uncertainty, where all scans have the standard deviations `x` and `y` (m)."""
    drawing = plan_drawing(with_states(data, sigma=np.tile([x, y], (len(data.trajectory_map), 1))))
    rings = [shapely.LinearRing(outline) for outline in drawing.band]
    outer = shapely.union_all([shapely.Polygon(ring) for ring in rings if ring.is_ccw])
    return outer.difference(shapely.union_all([shapely.Polygon(ring) for ring in rings if not ring.is_ccw]))


@pytest.mark.parametrize(("x", "y"), [(0.1, 0.1), (0.02, 0.3), (0.3, 0.02)])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_band_reaches_two_standard_deviations_to_either_side(x: float, y: float, axis: int) -> None:
    data = sample()
    poses = np.tile(np.eye(4), (500, 1, 1))  # along x or y of the building
    poses[:, :3, 3] = 5.0, 5.0, 4.0
    poses[:, axis, 3] += np.linspace(0, 10, 500)
    low_x, low_y, high_x, high_y = band(with_poses(data, np.linalg.inv(T_BIM_MAP) @ poses), x, y).bounds
    expected = 4 * np.array([x, y]) + np.eye(2)[axis] * 10
    assert np.array([high_x - low_x, high_y - low_y]) == pytest.approx(expected, abs=0.003 + 0.01 * max(x, y))


def test_the_band_follows_the_way_round_holes_and_leaves_out_what_is_not_known() -> None:
    data = with_lost_scans(sample())
    assert data.truth is not None
    places = data.truth.positions[:, :2]
    found = band(data, 0.05, 0.05)
    way = shapely.union_all([shapely.LineString(places[a:b]) for a, b in ((0, 100), (130, 400), (450, 500))])
    assert shapely.symmetric_difference(found, way.buffer(0.1)).area < 0.02 * found.area
    assert not shapely.contains_xy(found, places[[115, 425]]).any()
    for sigma in (np.nan, 0.0):
        assert band(sample(), sigma, sigma).is_empty
    poses, angles = np.tile(np.eye(4), (500, 1, 1)), np.linspace(0, 4 * np.pi, 500)  # twice round a circle of 3 m
    poses[:, :3, 3] = np.column_stack([5 + 3 * np.cos(angles), 5 + 3 * np.sin(angles), np.full(500, 4.0)])
    ring = band(with_poses(sample(), np.linalg.inv(T_BIM_MAP) @ poses), 0.5, 0.5)
    assert ring.area == pytest.approx(np.pi * (4**2 - 2**2), rel=0.01)


def test_errors_against_time_are_those_of_the_metrics() -> None:
    data = shifted(sample(), np.random.default_rng(0).normal(0, 0.02, (500, 3)))
    assert data.truth is not None and data.T_bim_map is not None
    in_bim = data.trajectory_map.transformed(data.T_bim_map)
    expected = accuracy(in_bim, data.trajectory_map, data.trajectory_odometry, data.truth)
    odometry, trajectory = error_lines(data)
    assert np.sqrt(np.mean(trajectory.errors**2)) == pytest.approx(expected["rmse_bim_m"])
    assert trajectory.errors.max() == pytest.approx(expected["max_bim_m"])
    assert np.sqrt(np.mean(odometry.errors**2)) == pytest.approx(expected["rmse_odometry_aligned_m"])
    assert trajectory.seconds[[0, -1]] == pytest.approx([0.0, 49.9])
    found = chart_data(data, error_lines(data), drawing := plan_drawing(data))
    east, south = np.array(found["place"]).T + np.array([[1], [-1]]) * drawing.centre()[:, None]
    assert np.allclose([east, -south], in_bim.positions[:, :2].T, atol=2e-3)
    common = np.tile([0.3, 0.0, 0.0], (500, 1))  # counts only where nothing is aligned
    assert np.allclose(error_lines(shifted(sample(), common))[1].errors, 0.3)
    assert error_lines(shifted(not_anchored("ambiguous"), common))[1].errors.max() < 1e-6
    lines = {line.name: line for line in error_lines(with_lost_scans(sample()))}
    assert len(lines["trajectory"].errors) == 420 and lines["trajectory"].errors.max() < 1e-6


def test_what_cannot_be_compared_has_no_error() -> None:
    data = sample()
    assert data.truth is not None
    standing = Trajectory(data.trajectory_odometry.stamps_ns, np.tile(np.eye(4), (500, 1, 1)))
    assert [line.name for line in error_lines(replace(data, trajectory_odometry=standing))] == ["trajectory"]
    other_clock = Trajectory(data.truth.stamps_ns + 10**15, data.truth.poses)
    for truth in (None, other_clock):
        assert error_lines(replace(data, truth=truth)) == []


@pytest.mark.parametrize(("scale", "logarithmic"), [(0.001, True), (0.2, False)])
def test_the_chart_of_a_long_run_is_small_and_no_peak_is_lost(scale: float, logarithmic: bool) -> None:
    offsets = np.random.default_rng(1).normal(0, scale, (20_000, 3)).clip(-2 * scale, 2 * scale)
    offsets[12_345] = [0.8, 0.0, 0.0]
    data = shifted(sample(20_000), offsets)
    assert data.truth is not None
    known = np.r_[0:5000, 15_000:20_000]
    gap = replace(data, truth=Trajectory(data.truth.stamps_ns[known], data.truth.poses[known]))
    svg = error_chart(data, error_lines(data))
    assert len(svg) < 80_000 and "800.0 mm" in svg and ("logarithmic" in svg) is logarithmic
    assert "14.2 s" in svg and "nan" not in svg and "inf" not in svg  # since when it is anchored
    assert "800.0 mm" not in error_chart(gap, error_lines(gap))
