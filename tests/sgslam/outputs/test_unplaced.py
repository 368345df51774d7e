"""What the report and plan.png tell of lost scans, parts and floors that were not placed, and withdrawn anchors."""

import dataclasses
import json
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import shapely
from report_samples import Page, anchor, not_anchored, on_two_floors, sample, with_lost_scans

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.config import QualitySettings
from sgslam.report import ReportData
from sgslam.report.contents import entered_unmatched, split_by_floor
from sgslam.report.drawn_paths import MAX_VERTICES
from sgslam.report.error_chart import error_lines
from sgslam.report.number_formats import signal_texts
from sgslam.report.page import report_html
from sgslam.report.plan_drawing import plan_drawing
from sgslam.report.plan_png import LOST, WITHDRAWN, write_plan_png
from sgslam.report.tables import known_rows, relocalised
from sgslam.session.soundness.quality import quality_of
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty

GREY, MARKS = "lost", "planned wall whose anchor was withdrawn"
WHY = "the walls no longer agree on a place in the plan"


def plans(html: str) -> list[str]:
    """The SVG of each storey."""
    return re.findall(r'<svg id="plan[^>]*>.*?</svg>', html, re.DOTALL)


def of_color(data: ReportData, folder: Path, color: str) -> int:
    """How many pixels of plan.png have a colour."""
    write_plan_png(data, folder / "plan.png")
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    image = matplotlib.image.imread(folder / "plan.png")[..., :3]
    return int((np.abs(image - rgb).max(axis=-1) < 0.003).sum())


def without_anchor_at(data: ReportData, *a_ids: str) -> ReportData:
    """The same run, but that the anchors to these planned walls were withdrawn."""
    anchors = [anchor(a["wall"], a["a_id"], WHY) if a["a_id"] in a_ids else a for a in data.anchors]
    return dataclasses.replace(data, anchors=anchors)


def with_sigma(data: ReportData, x: float, y: float) -> ReportData:
    assert data.scans is not None
    sigma = np.tile([x, y], (len(data.trajectory_map), 1))
    return dataclasses.replace(data, scans=dataclasses.replace(data.scans, sigma=sigma))


def band_of(data: ReportData) -> shapely.Geometry:
    drawing = plan_drawing(data)
    return shapely.union_all([shapely.Polygon(outline) for outline in drawing.band])


def test_a_sound_run_has_nothing_grey_nothing_unplaced_and_no_mark() -> None:
    for data in (sample(), on_two_floors(placed=True)):
        html = report_html(data)
        page = Page(html)
        assert not {"layer-lost", "layer-anchors-withdrawn"} & {layer for layer, _ in page.layers}
        assert not re.search(f"not placed|{MARKS}|withdrawn|Lost scans", page.text)
        scene = json.loads(page.inside["scene-data"])
        assert "lost" not in scene["paths"] and "anchors-withdrawn" not in {wall[0] for wall in scene["walls"]}


def test_lost_scans_are_grey_and_parts_that_were_not_placed_are_not_drawn() -> None:
    data = with_lost_scans(sample())
    page = Page(report_html(data))
    assert page.layers["layer-lost", "polyline"] == 1
    assert page.layers["layer-trajectory", "polyline"] == 3 + 2  # with the start and the end
    assert "lost: 10.0 to 12.9 s" in page.text and re.search(rf"{GREY}\n", page.text)
    assert "Lost scans\n30\n" in page.text
    assert "Scans in parts not placed\n50, between 40.0 and 44.9 s; they are not drawn\n" in page.text
    pieces = plan_drawing(data).paths
    assert data.truth is not None
    violet = np.vstack([piece.points for piece in pieces["trajectory"]])
    assert np.allclose(violet, data.truth.positions[np.r_[0:100, 130:400, 450:500]])
    (lost,) = pieces["lost"]
    assert np.allclose(lost.points, data.truth.positions[99:131])  # with the known scans on either side
    scene = json.loads(page.inside["scene-data"])
    assert [len(piece) // 3 for piece in scene["paths"]["lost"]] == [32]


def test_lost_scans_before_a_part_that_was_not_placed_do_not_lead_to_it() -> None:
    data = with_lost_scans(sample())
    assert data.scans is not None and data.truth is not None
    lost = data.scans.lost.copy()
    lost[390:400] = True
    before = dataclasses.replace(data, scans=dataclasses.replace(data.scans, lost=lost))
    *_, piece = plan_drawing(before).paths["lost"]
    assert np.allclose(piece.points, data.truth.positions[389:400])


def test_without_a_plan_or_a_place_in_it_lost_scans_are_grey_as_well() -> None:
    for data in (not_anchored("ambiguous"), dataclasses.replace(not_anchored("none"), a_graph=None, matches=None)):
        assert Page(report_html(data)).layers["layer-lost", "polyline"] == 0
        page = Page(report_html(with_lost_scans(data)))
        assert page.layers["layer-lost", "polyline"] == 1 and page.layers["layer-uncertainty", "path"] == 0


def test_a_run_of_which_nothing_is_known_is_all_grey(tmp_path: Path) -> None:
    data = sample()
    assert data.scans is not None
    lost = dataclasses.replace(data, scans=dataclasses.replace(data.scans, lost=np.ones(500, bool)), truth=None)
    page = Page(report_html(lost))
    assert page.layers["layer-lost", "polyline"] == 1 and page.layers["layer-trajectory", "polyline"] == 0
    assert page.layers["layer-uncertainty", "path"] == 0
    write_plan_png(lost, tmp_path / "plan.png")


def test_one_lost_scan_of_a_long_run_is_seen() -> None:
    data = sample(count=20_000)
    assert data.scans is not None
    lost = data.scans.lost.copy()
    lost[12_345] = True
    (grey,) = plan_drawing(dataclasses.replace(data, scans=dataclasses.replace(data.scans, lost=lost))).paths["lost"]
    assert 2 <= len(grey.points) <= 3 and "1234." in grey.title
    flickering = dataclasses.replace(data.scans, lost=np.arange(20_000) % 20 < 10)
    paths = plan_drawing(dataclasses.replace(data, scans=flickering)).paths
    assert sum(len(piece.points) for kind in ("trajectory", "lost") for piece in paths[kind]) < 2.5 * MAX_VERTICES


def test_a_part_that_was_not_placed_does_not_shrink_the_plan() -> None:
    data = with_lost_scans(sample())
    poses = data.trajectory_map.poses.copy()
    poses[400:450, :2, 3] *= 100
    far = dataclasses.replace(data, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))
    (low, high), (usual_low, usual_high) = plan_drawing(far).bounds(), plan_drawing(sample()).bounds()
    assert (high - low).max() < 2 * (usual_high - usual_low).max()


def test_errors_are_those_of_known_scans() -> None:
    lines = {line.name: line for line in error_lines(with_lost_scans(sample()))}
    assert len(lines["trajectory"].errors) == 420 and lines["trajectory"].errors.max() < 1e-6
    lines = {line.name: line for line in error_lines(sample())}
    assert len(lines["trajectory"].errors) == 500


def test_floors_are_named_and_one_without_a_place_is_said_to_have_none() -> None:
    html = report_html(on_two_floors(placed=True))
    for svg, name in zip(plans(html), ("Storey 0", "Storey 1"), strict=True):
        assert f"<h2>{name}</h2>" in html and svg.count("layer-bim-walls") == 2  # lines and names
    html = report_html(on_two_floors(placed=False))
    ground, upper = plans(html)
    assert re.findall("<h2>(.*?)</h2>", html)[:2] == ["Storey 0", "floor-1 of the map: not placed in the plan"]
    assert "layer-bim-walls" in ground and "layer-bim-walls" not in upper
    assert upper.count("<polyline data-wall") == 36 and "layer-walls-matched" not in upper


def test_a_floor_without_a_place_is_in_no_planned_room() -> None:
    for placed in (True, False):
        data = on_two_floors(placed)
        unmatched = dataclasses.replace(data, matches={**(data.matches or {}), "rooms": []})
        found = [entered_unmatched(part) for part in split_by_floor(unmatched)]
        assert found[0] and bool(found[1]) is placed


def test_the_way_between_two_floors_is_drawn_on_the_one_that_was_left() -> None:
    data = on_two_floors(placed=True)
    assert [len(part.trajectory_map) for part in split_by_floor(data)] == [300, 200]
    lost = with_lost_scans(data)
    assert lost.scans is not None
    between = dataclasses.replace(lost.scans, lost=np.isin(np.arange(500), np.arange(220, 230)))
    html = report_html(dataclasses.replace(lost, scans=between))
    ground, upper = plans(html)
    assert "lost: 22.0 to 22.9 s" in ground and "lost:" not in upper


def test_the_legend_names_what_only_another_floor_shows() -> None:
    html = report_html(without_anchor_at(on_two_floors(placed=True), "r1n0.0"))
    ground, upper = plans(html)
    assert "anchors-withdrawn" not in ground and "anchors-withdrawn" in upper
    assert html.count(MARKS) == 1


def test_withdrawn_anchors_are_marked_with_their_reason() -> None:
    data = without_anchor_at(sample(), "r1n0.0", "c1.2")
    html = report_html(data)
    page = Page(html)
    assert page.layers["layer-anchors-withdrawn", "polyline"] == 2
    assert page.text.count(f"anchor withdrawn: {WHY}") == 2 and page.text.count(f"{MARKS}\n") == 2
    marks = {wall.id: wall for wall in plan_drawing(data).withdrawn}
    planned = {wall.id: wall for wall in plan_drawing(data).bim_walls}
    assert set(marks) == {"r1n0.0", "c1.2"}
    assert all(np.array_equal(marks[a_id].ends, planned[a_id].ends) for a_id in marks)
    scene = json.loads(page.inside["scene-data"])
    assert [wall[0] for wall in scene["walls"]].count("anchors-withdrawn") == 2


def test_a_planned_wall_that_is_anchored_again_has_no_mark() -> None:
    data = sample()
    merged = dataclasses.replace(data, anchors=[anchor("w99", "c1.2", WHY), *data.anchors])  # another wall holds it
    assert not plan_drawing(merged).withdrawn
    of_another_storey = dataclasses.replace(data, anchors=[anchor("w99", "c0.2", WHY), *data.anchors])
    assert not plan_drawing(of_another_storey).withdrawn


def test_a_run_that_lost_its_place_shows_what_its_anchors_stood_on() -> None:
    data = not_anchored("ambiguous")
    gone = dataclasses.replace(data, anchors=[anchor(a["wall"], a["a_id"], WHY) for a in data.anchors])
    assert Page(report_html(gone)).layers["layer-anchors-withdrawn", "polyline"] == 36


@pytest.mark.parametrize(("x", "y"), [(0.1, 0.1), (0.02, 0.3), (0.3, 0.02)])
def test_the_band_reaches_two_standard_deviations_to_either_side(x: float, y: float) -> None:
    data = sample()
    assert data.truth is not None and data.T_bim_map is not None
    for axis in (0, 1):  # along x and y of the building
        poses = data.truth.poses.copy()
        poses[:, :2, 3] = 5.0
        poses[:, axis, 3] += np.linspace(0, 10, 500)
        in_map = Trajectory(data.truth.stamps_ns, np.linalg.inv(data.T_bim_map) @ poses)
        low_x, low_y, high_x, high_y = band_of(
            with_sigma(dataclasses.replace(data, trajectory_map=in_map), x, y)
        ).bounds
        size = np.array([high_x - low_x, high_y - low_y])
        expected = 4 * np.array([x, y]) + np.eye(2)[axis] * 10
        assert size == pytest.approx(expected, abs=0.003 + 0.01 * max(x, y))


def test_the_band_follows_the_way_and_leaves_out_what_is_not_known() -> None:
    data = with_lost_scans(sample())
    assert data.truth is not None
    places = data.truth.positions[:, :2]
    band = band_of(with_sigma(data, 0.05, 0.05))
    way = shapely.union_all([shapely.LineString(places[a:b]) for a, b in ((0, 100), (130, 400), (450, 500))])
    assert shapely.symmetric_difference(band, way.buffer(0.1)).area < 0.02 * band.area
    assert not shapely.contains_xy(band, places[[115, 425]]).any()
    assert shapely.contains_xy(band_of(with_sigma(sample(), 0.05, 0.05)), places[[115, 425]]).all()


def test_a_wide_band_that_crosses_itself_has_holes_and_no_overlap(tmp_path: Path) -> None:
    data = sample()
    assert data.truth is not None and data.T_bim_map is not None
    poses = data.truth.poses.copy()
    angles = np.linspace(0, 4 * np.pi, 500)  # twice round a circle of 3 m
    poses[:, :2, 3] = 5 + 3 * np.column_stack([np.cos(angles), np.sin(angles)])
    in_map = Trajectory(data.truth.stamps_ns, np.linalg.inv(data.T_bim_map) @ poses)
    drawing = plan_drawing(with_sigma(dataclasses.replace(data, trajectory_map=in_map), 0.5, 0.5))
    outer, hole = (shapely.LinearRing(outline) for outline in drawing.band)
    assert outer.is_ccw and not hole.is_ccw
    assert shapely.Polygon(outer).area - shapely.Polygon(hole).area == pytest.approx(np.pi * (4**2 - 2**2), rel=0.01)


def test_the_band_of_an_hours_run_is_small() -> None:
    data = sample(count=36_000)
    assert data.scans is not None
    sigma = np.random.default_rng(0).uniform(0.005, 0.3, (36_000, 2))
    html = report_html(dataclasses.replace(data, scans=dataclasses.replace(data.scans, sigma=sigma)))
    (band,) = re.findall('<g class="layer-uncertainty">(<path.*?)</g>', plans(html)[0])
    assert 200 < len(band) < 100_000


def test_scans_without_a_known_uncertainty_have_no_band() -> None:
    assert Page(report_html(sample())).layers["layer-uncertainty", "path"] == 1
    for sigma in (np.nan, 0.0):
        assert Page(report_html(with_sigma(sample(), sigma, sigma))).layers["layer-uncertainty", "path"] == 0


def test_plan_png_shows_what_is_lost_and_withdrawn(tmp_path: Path) -> None:
    sound = sample()
    assert of_color(sound, tmp_path, WITHDRAWN) == 0
    assert of_color(without_anchor_at(sound, "r1n0.0"), tmp_path, WITHDRAWN) > 300
    assert of_color(with_lost_scans(sound), tmp_path, LOST) > of_color(sound, tmp_path, LOST) + 300


def test_plan_png_shows_where_the_position_is_uncertain(tmp_path: Path) -> None:
    light = "#e2d4f7"
    thin, wide = (of_color(with_sigma(sample(), sigma, sigma), tmp_path, light) for sigma in (0.001, 0.5))
    assert wide > 20 * max(thin, 100)


def test_every_signal_of_quality_has_a_phrase_and_a_unit() -> None:
    data = sample()
    uncertainty = ScanUncertainty(
        data.trajectory_map.stamps_ns, np.full((500, 6), 0.01), np.zeros(500, np.int64), ("floor-0",) * 500,
        np.ones(500, bool), ("good",) * 500,
    )  # fmt: skip
    found = quality_of(
        data.trajectory_map, data.trajectory_odometry, [0], [4] * 50, uncertainty, 0.0, 0.0, data.T_bim_map,
        data.a_graph, QualitySettings(),
    )  # fmt: skip
    assert len(found) == 8
    told = {name: signal_texts(name, dataclasses.asdict(signal)) for name, signal in found.items()}
    assert not any("_" in text for texts in told.values() for text in texts)
    assert told["map_against_odometry"][0] == "difference of map and odometry, share of the path length"
    assert told["map_against_odometry"][2] == "at most 1 %" and told["walls_per_keyframe"][1:] == ("4", "at least 3")
    assert told["position_sigma_m"][1:] == ("0.0173 m", "at most 0.2 m")


def test_what_the_report_shows_of_the_scans_comes_from_their_uncertainty() -> None:
    sigma = np.arange(18.0).reshape(3, 6)
    states = ScanUncertainty(
        np.array([5, 7, 9]) * 1_000_000_000, sigma, np.array([0, 0, 2]), ("", "", ""), np.array([True, False, False]),
        ("degraded", "lost", "good"),
    ).states()  # fmt: skip
    assert states.known.tolist() == [True, False, False] and states.seconds.tolist() == [0, 2, 4]
    assert states.lost.tolist() == [False, True, False] and states.part.tolist() == [0, 0, 2]
    assert np.array_equal(states.sigma, sigma[:, :2])


def test_a_map_without_scans_on_a_floor_has_its_plan(tmp_path: Path) -> None:
    data = on_two_floors(placed=True)
    keyframes = tuple(dataclasses.replace(k, floor="floor-0") for k in data.s_graph.keyframes)
    s_graph: SceneGraph = dataclasses.replace(data.s_graph, keyframes=keyframes)
    html = report_html(dataclasses.replace(data, s_graph=s_graph))
    assert len(plans(html)) == 2 and "layer-trajectory" not in plans(html)[1]


@pytest.mark.parametrize("found", [True, False])
def test_why_the_last_part_was_not_placed_is_in_the_report(found: bool) -> None:
    data = with_lost_scans(sample())
    outcome = {"found": found, "found_s": 2.0 if found else None, "reason": "the plan does not explain the map"}
    page = Page(report_html(dataclasses.replace(data, metrics=data.metrics | {"returned": outcome})))
    assert ("Why the last part was not placed\nthe plan does not explain the map" in page.text) == (not found)


@pytest.mark.parametrize(
    ("found", "found_s", "text"),
    [
        (True, 9.04, "9.0 s after the last part began: why"), (True, None, "why"),
        (False, None, "the last part was not placed: why"),
    ],
)  # fmt: skip
def test_the_terminal_says_when_the_last_part_was_placed(found: bool, found_s: float | None, text: str) -> None:
    assert relocalised({"found": found, "found_s": found_s, "reason": "why"}) == text


@pytest.mark.parametrize(("anchored", "whose"), [(True, "anchored positions"), (False, "positions")])
def test_of_an_anchored_run_the_anchored_positions_are_known(anchored: bool, whose: str) -> None:
    metrics = {"anchored": anchored, "quality": {"position_sigma_m": {"value": 0.0194, "limit": 0.2, "ok": True}}}
    assert known_rows(metrics) == [(f"95 % of the {whose}", "have a standard deviation of at most 19.4 mm")]
