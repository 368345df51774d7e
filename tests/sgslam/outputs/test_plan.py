"""The plan: what is drawn where, in which colour, and the PNG of it."""

import dataclasses
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from report_samples import not_anchored, sample

from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import BANDS, LIMITS_MM, band_of, deviation_text, signed_mm
from sgslam.report.contents import current_storey
from sgslam.report.plan_drawing import STOREY_M, plan_drawing
from sgslam.report.plan_png import write_plan_png


def test_the_map_lies_on_the_plan_when_anchored() -> None:
    drawing = plan_drawing(sample())
    assert drawing.heading == "Storey 1"
    for ours, planned in zip(drawing.map_walls, drawing.bim_walls, strict=False):
        assert np.allclose(ours.ends, planned.ends, atol=1e-9)
    assert np.allclose(drawing.match_lines[:, 0], drawing.match_lines[:, 1], atol=1e-9)
    assert np.allclose(drawing.paths["trajectory"][0].points, drawing.paths["truth"][0].points, atol=1e-9)
    away = np.linalg.norm(drawing.paths["odometry"][0].points - drawing.paths["truth"][0].points, axis=1)
    assert away[0] < 1e-9 and away[-1] > 0.3
    low, high = drawing.bounds()
    assert np.allclose(low, [0, -5.2]) and high[1] == pytest.approx(7.4)


def test_a_map_without_a_place_lies_beside_the_plan() -> None:
    drawing = plan_drawing(not_anchored("none"))
    assert "beside" in drawing.heading and not len(drawing.match_lines)
    right_of_plan = max(w.ends[:, 0].max() for w in drawing.bim_walls)
    assert min(w.ends[:, 0].min() for w in drawing.map_walls if w.title[:5] != "Scupb") > right_of_plan - 3
    assert not any(w.matched for w in drawing.map_walls)


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
    floor = current_storey(dataclasses.replace(sample(), **change))
    assert floor is not None and floor.id == expected


def test_plan_png_shows_all_its_colours(tmp_path: Path) -> None:
    data = sample()
    write_plan_png(data, tmp_path / "plan.png")
    image = matplotlib.image.imread(tmp_path / "plan.png")
    assert image.shape[1] > 1200
    for color in ("#a3a9b2", "#0f8a7b", "#c0508c", "#6d28d9", "#1f4aa8", "#dd7a1c"):
        rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        assert (np.abs(image[..., :3] - rgb).max(axis=-1) < 0.02).sum() > 50, color
    assert [p.name for p in tmp_path.iterdir()] == ["plan.png"]


def test_bands_grow_outward_on_both_sides() -> None:
    assert band_of(None) is None
    assert band_of(0.0) == band_of(0.0099) == band_of(-0.0099) == "as-planned"
    offsets = [-5.0, -0.1, -0.099, -0.03, -0.029, -0.01, 0.0, 0.01, 0.029, 0.03, 0.099, 0.1, 5.0]
    steps = [BANDS.index(band_of(offset) or "") for offset in offsets]
    assert steps == sorted(steps) and set(steps) == set(range(7)) and len(BANDS) == 2 * len(LIMITS_MM) + 1
    assert [signed_mm(v) for v in (0.01234, -0.0004, -0.00004, None)] == [
        "+12.3 mm", "\N{MINUS SIGN}0.4 mm", "0.0 mm", "",
    ]  # fmt: skip


def test_walls_carry_their_deviation() -> None:
    drawing = plan_drawing(sample())
    moved = drawing.map_walls[5]
    assert moved.band == "back-3" and moved.significant
    for text in ("-123.4 mm".replace("-", "\N{MINUS SIGN}"), "sigma 10.0 mm", "+0.57°", "significant", moved.id):
        assert text in moved.title
    assert drawing.map_walls[7].band == "into-2"
    assert {w.band for i, w in enumerate(drawing.map_walls) if i not in (5, 7, 36)} == {"as-planned"}
    cupboard = drawing.map_walls[36]
    assert cupboard.band is None and "extra" in cupboard.title and not cupboard.matched
    assert [w.id for w in drawing.bim_walls if w.title.endswith("not found")] == ["r1n0.0"]
    assert not plan_drawing(not_anchored("ambiguous")).with_deviations


def test_a_deviation_of_few_words_is_told() -> None:
    short = {"kind": "moved", "offset_m": 0.04, "tilt_rad": None, "sigma_m": None, "significant": True}
    assert deviation_text(short) == "offset +40.0 mm, significant"


def test_heights_are_those_of_the_storey() -> None:
    data = sample()
    drawing = plan_drawing(data)
    assert drawing.floor_z == 3.5
    assert all(w.z == (3.5, 3.5 + STOREY_M) for w in drawing.bim_walls)  # where none is known
    assert np.allclose([w.z for w in drawing.map_walls[:36]], [3.6, 5.1])  # over the floor
    assert np.allclose(drawing.paths["trajectory"][0].points[:, 2], 4.0) and np.allclose(drawing.keyframes[:, 2], 4.0)
    # a guess knows no height: the map's floor, 0.5 m below its origin, is laid on the storey's
    guess = plan_drawing(not_anchored("ambiguous"))
    assert np.allclose(guess.paths["trajectory"][0].points[:, 2], 4.0)
    alone = plan_drawing(dataclasses.replace(data, a_graph=None, T_bim_map=None, matches=None, truth=None))
    assert alone.floor_z == -0.5
    s_graph = SceneGraph("map", (), (), (), ())
    blind = dataclasses.replace(data, a_graph=None, T_bim_map=None, matches=None, truth=None, s_graph=s_graph)
    assert plan_drawing(blind).floor_z == pytest.approx(-1.0)


def test_an_odometry_that_strays_does_not_shrink_the_plan() -> None:
    data = sample()
    poses = data.trajectory_odometry.poses.copy()
    poses[:, :3, 3] *= 50
    stray = dataclasses.replace(data, trajectory_odometry=Trajectory(data.trajectory_odometry.stamps_ns, poses))
    (low, high), (usual_low, usual_high) = plan_drawing(stray).bounds(), plan_drawing(data).bounds()
    assert (high - low).max() < 2 * (usual_high - usual_low).max()
    assert np.ptp(plan_drawing(stray).paths["odometry"][0].points[:, 0]) > 200
