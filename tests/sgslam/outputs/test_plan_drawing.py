"""What plan.png and the report's plan draw where, which scans they leave out, and the error against time."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from report_samples import APART, LOST, not_anchored, on_two_floors, reported, with_lost_scans

from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import BANDS, band_of
from sgslam.geometry.trajectory_errors import accuracy
from sgslam.report import ReportData
from sgslam.report.contents import current_storey, split_by_floor
from sgslam.report.drawn_paths import MAX_VERTICES
from sgslam.report.error_chart import error_chart, error_lines
from sgslam.report.plan_drawing import plan_drawing


@pytest.fixture(scope="module")
def data(anchored_run: Path) -> ReportData:
    return reported(anchored_run)


def test_bands_grow_outward_on_both_sides() -> None:
    offsets = [-5.0, -0.1, -0.099, -0.03, -0.029, -0.01, 0.0, 0.01, 0.029, 0.03, 0.099, 0.1, 5.0]
    steps = [BANDS.index(band_of(offset) or "") for offset in offsets]
    assert steps == sorted(steps) and set(steps) == set(range(len(BANDS)))


def test_the_map_lies_on_the_plan_when_anchored(data: ReportData) -> None:
    drawing = plan_drawing(data)
    assert drawing.heading == "Ground" and len(drawing.layers["walls-matched"]) > 10
    way, truth = (drawing.layers[name][0].points for name in ("trajectory", "truth"))
    assert np.abs(way - truth).max() < 0.05
    found = {wall.title.split()[0]: wall for wall in drawing.layers["walls-matched"]}
    for deviation in data.deviations:
        if deviation["kind"] == "moved":
            assert f"band-{band_of(deviation['offset_m'])}" in found[deviation["s_id"]].looks


def test_a_map_without_a_place_lies_beside_the_plan_or_where_it_is_guessed(data: ReportData) -> None:
    drawing = plan_drawing(not_anchored(data, "none"))
    assert not drawing.layers["walls-matched"]
    right_of_plan = max(w.points[:, 0].max() for w in drawing.layers["bim-walls"])
    assert min(w.points[:, 0].min() for w in drawing.layers["walls-unmatched"]) > right_of_plan
    guess = plan_drawing(not_anchored(data, "ambiguous"))
    placed = {wall.title.split()[0]: wall for wall in plan_drawing(data).layers["walls-matched"]}
    assert len(guess.layers["walls-matched"]) == len(placed) > 5
    for wall in guess.layers["walls-matched"]:
        np.testing.assert_allclose(wall.points, placed[wall.title.split()[0]].points, atol=0.15)
    assert not guess.with_deviations


def test_the_robots_storey_is_the_matched_one_or_that_with_the_most_rooms(data: ReportData) -> None:
    run = on_two_floors(data, placed=True)
    guessed = {"floor": None, "hypotheses": [{"floor": "upper"}]}
    for change, expected in (({}, "Ground"), ({"matches": None}, "Ground"), ({"matches": guessed}, "Upper")):
        floor = current_storey(replace(run, **change))
        assert floor is not None and floor.name == expected


def test_lost_scans_are_a_path_of_their_own_and_unplaced_parts_are_none(data: ReportData) -> None:
    whole, lost = plan_drawing(data), plan_drawing(with_lost_scans(data))
    (way,) = whole.layers["trajectory"]
    known = np.vstack([piece.points for piece in lost.layers["trajectory"]])
    assert np.allclose(known, np.delete(way.points, np.r_[LOST, APART], axis=0))
    (grey,) = lost.layers["lost"]
    assert np.allclose(grey.points, way.points[LOST.start - 1 : LOST.stop + 1])  # with the known scans on either side
    assert not whole.layers["lost"]
    assert np.allclose(np.ptp(lost.bounds(), axis=0), np.ptp(whole.bounds(), axis=0), rtol=0.5)  # far parts count not


def test_of_two_floors_each_has_its_own_part_of_the_way(data: ReportData) -> None:
    """Between them the robot is on the one that was left."""
    run = on_two_floors(data, placed=True)
    lower, upper = split_by_floor(run)
    begin = run.s_graph.keyframes[30].stamp_ns
    assert lower.trajectory_map.stamps_ns[-1] < begin == upper.trajectory_map.stamps_ns[0]
    assert len(lower.trajectory_map) + len(upper.trajectory_map) == len(run.trajectory_map)


@pytest.mark.parametrize(("x", "y"), [(0.02, 0.3), (0.3, 0.02)])
def test_the_band_reaches_two_standard_deviations_to_either_side(data: ReportData, x: float, y: float) -> None:
    """Of a way of 10 m along x; where nothing is known there is none."""
    assert data.T_bim_map is not None and data.scans is not None
    poses = np.tile(np.eye(4), (248, 1, 1))
    poses[:, :3, 3] = 3005.0, -1995.0, 43.8
    poses[:, 0, 3] += np.linspace(0, 10, 248)
    way = Trajectory(data.trajectory_map.stamps_ns, np.linalg.inv(data.T_bim_map) @ poses)

    def band(sigma: tuple[float, float]) -> shapely.Geometry:
        scans = replace(data.scans, sigma=np.tile(sigma, (248, 1)))
        drawing = plan_drawing(replace(data, trajectory_map=way, scans=scans))
        return shapely.union_all([shapely.Polygon(area.points) for area in drawing.layers["uncertainty"]])

    low_x, low_y, high_x, high_y = band((x, y)).bounds
    assert (high_x - low_x, high_y - low_y) == pytest.approx((10 + 4 * x, 4 * y), abs=0.01)
    assert band((np.nan, np.nan)).is_empty


def test_errors_against_time_are_those_of_the_metrics(data: ReportData) -> None:
    assert data.truth is not None and data.T_bim_map is not None
    in_bim = data.trajectory_map.transformed(data.T_bim_map)
    expected = accuracy(in_bim, data.trajectory_map, data.trajectory_odometry, data.truth)
    odometry, trajectory = error_lines(data)
    assert np.sqrt(np.mean(trajectory.errors**2)) == pytest.approx(expected["rmse_bim_m"])
    assert np.sqrt(np.mean(odometry.errors**2)) == pytest.approx(expected["rmse_odometry_aligned_m"])
    lines = {line.name: line for line in error_lines(with_lost_scans(data))}
    assert len(lines["trajectory"].errors) == 188 and lines["trajectory"].errors.max() < 0.05
    other_clock = Trajectory(data.truth.stamps_ns + 10**15, data.truth.poses)
    for truth in (None, other_clock):
        assert error_lines(replace(data, truth=truth)) == []


def test_of_a_long_run_little_is_drawn_and_no_peak_is_lost(data: ReportData) -> None:
    """The same run over and over, back and forth; one scan is 0.8 m off."""
    assert data.truth is not None and data.scans is not None
    chosen = np.abs((np.arange(20_000) + 247) % 494 - 247)
    stamps, poses = np.arange(len(chosen)) * 100_000_000, data.trajectory_map.poses[chosen]
    odometry = poses.copy()
    odometry[:, :3, 3] *= 1.1
    poses[12_345, 0, 3] += 0.8
    paths = {"map": poses, "odometry": odometry, "truth": data.truth.poses[chosen]}
    found = {name: Trajectory(stamps, own) for name, own in paths.items()}
    run = replace(data, trajectory_map=found["map"], trajectory_odometry=found["odometry"], truth=found["truth"])
    run = replace(run, scans=data.scans.only(chosen))
    svg = error_chart(run, error_lines(run))
    assert len(svg) < 80_000 and "nan" not in svg and "inf" not in svg
    assert re.search(r"(79|80)\d\.\d mm", error_lines(run)[1].summary())
    assert run.scans is not None
    health = np.where(np.arange(len(chosen)) == 12_345, "lost", "good")
    lost = replace(run, scans=replace(run.scans, health=health))
    (grey,) = plan_drawing(lost).layers["lost"]
    assert 2 <= len(grey.points) <= 3  # one lost scan is seen
    assert len(plan_drawing(run).layers["trajectory"][0].points) == MAX_VERTICES
