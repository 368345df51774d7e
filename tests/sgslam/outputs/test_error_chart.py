"""The error against time: what is compared with what, and what is drawn of it."""

import dataclasses
import re

import numpy as np
import pytest
from report_samples import not_anchored, sample

from data.trajectory import Trajectory
from sgslam.report import ReportData
from sgslam.report.accuracy import accuracy
from sgslam.report.error_chart import BINS, HEIGHT, WIDTH, chart_data, error_chart, error_lines
from sgslam.report.plan_drawing import plan_drawing


def shifted(data: ReportData, offsets: np.ndarray) -> ReportData:
    """The run with its map trajectory moved by `offsets` (N, 3) in the map frame."""
    poses = data.trajectory_map.poses.copy()
    poses[:, :3, 3] += offsets
    return dataclasses.replace(data, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))


def test_errors_are_those_of_the_metrics() -> None:
    data = shifted(sample(), np.random.default_rng(0).normal(0, 0.02, (500, 3)))
    assert data.truth is not None and data.T_bim_map is not None
    in_bim = data.trajectory_map.transformed(data.T_bim_map)
    wanted = accuracy(in_bim, data.trajectory_map, data.trajectory_odometry, data.truth)
    odometry, trajectory = error_lines(data)
    assert np.sqrt(np.mean(trajectory.errors**2)) == pytest.approx(wanted["rmse_bim_m"])
    assert trajectory.errors.max() == pytest.approx(wanted["max_bim_m"])
    assert np.sqrt(np.mean(odometry.errors**2)) == pytest.approx(wanted["rmse_odometry_aligned_m"])
    assert trajectory.seconds[0] == 0 and trajectory.seconds[-1] == pytest.approx(49.9)


def test_a_common_shift_counts_only_where_nothing_is_aligned() -> None:
    shift = np.tile([0.3, 0.0, 0.0], (500, 1))
    anchored = error_lines(shifted(sample(), shift))[1]
    assert np.allclose(anchored.errors, 0.3) and "not aligned" in anchored.label
    free = error_lines(shifted(not_anchored("ambiguous"), shift))[1]
    assert free.errors.max() < 1e-6 and free.label == "trajectory, aligned"


def test_what_cannot_be_aligned_is_left_out() -> None:
    data = sample()
    standing = Trajectory(data.trajectory_odometry.stamps_ns, np.tile(np.eye(4), (500, 1, 1)))
    assert [line.name for line in error_lines(dataclasses.replace(data, trajectory_odometry=standing))] == [
        "trajectory"
    ]
    assert error_lines(dataclasses.replace(data, truth=None)) == []
    assert data.truth is not None
    other_clock = Trajectory(data.truth.stamps_ns + 10**15, data.truth.poses)
    assert error_lines(dataclasses.replace(data, truth=other_clock)) == []


def drawn(data: ReportData) -> dict[str, list[np.ndarray]]:
    """By line the pieces of its polyline, (N, 2)."""
    svg = error_chart(data, error_lines(data))
    groups = re.findall(r'<g class="layer-(\w+)">((?:<poly[^>]*/>)+)</g>(?!</svg>)', svg)
    pieces = {name: re.findall(r'line points="([^"]*)', group) for name, group in groups}
    return {name: [np.array([p.split(",") for p in one.split()], float) for one in g] for name, g in pieces.items()}


def test_long_runs_are_thinned_and_no_peak_is_lost() -> None:
    offsets = np.zeros((20_000, 3))
    offsets[:, 0] = 0.01
    offsets[12_345, 0] = 0.8
    data = shifted(sample(20_000), offsets)
    svg = error_chart(data, error_lines(data))
    assert len(svg) < 60_000 and "largest 800.0 mm" in svg
    (line,) = drawn(data)["trajectory"]
    assert len(line) == BINS
    band = re.search(r'layer-trajectory"><polygon points="([^"]*)', svg)
    assert band is not None
    heights = [float(p.split(",")[1]) for p in band[1].split()]
    assert np.argmin(heights) == pytest.approx(12_345 / 20_000 * BINS, abs=1)
    assert line.min() > 0 and (line.max(axis=0) < [WIDTH, HEIGHT]).all()


def test_lines_are_broken_where_the_truth_is_not_known() -> None:
    data = sample(2000)
    assert data.truth is not None
    known = np.r_[0:500, 1500:2000]
    gap = dataclasses.replace(data, truth=Trajectory(data.truth.stamps_ns[known], data.truth.poses[known]))
    assert [len(drawn(d)["odometry"]) for d in (data, gap)] == [1, 2]


def test_the_first_anchor_is_marked_where_the_run_was_anchored() -> None:
    data = shifted(sample(), np.full((500, 3), 0.02))
    assert "first anchor, 14.2 s" in error_chart(data, error_lines(data))
    free = shifted(not_anchored("ambiguous"), np.full((500, 3), 0.02))
    assert "first anchor" not in error_chart(free, error_lines(free))


@pytest.mark.parametrize(("scale", "logarithmic"), [(0.001, True), (0.2, False)])
def test_the_axis_is_logarithmic_where_the_lines_lie_far_apart(scale: float, logarithmic: bool) -> None:
    data = shifted(sample(), np.random.default_rng(1).normal(0, scale, (500, 3)))
    svg = error_chart(data, error_lines(data))
    assert ("logarithmic" in svg) is logarithmic
    assert "nan" not in svg and "inf" not in svg


def test_the_pointer_finds_the_place_in_the_plan() -> None:
    data = sample()
    found = chart_data(data, error_lines(data), drawing := plan_drawing(data))
    assert len({len(found[k]) for k in ("seconds", "x", "place")}) == 1
    assert data.truth is not None
    east, south = np.array(found["place"]).T + np.array([[1], [-1]]) * drawing.centre()[:, None]
    assert np.allclose(east, data.truth.positions[:, 0], atol=2e-3)
    assert np.allclose(-south, data.truth.positions[:, 1], atol=2e-3)
    assert all(len(values) == len(found["x"]) for values in found["errors"].values())
    assert np.all(np.diff(found["x"]) >= 0)
