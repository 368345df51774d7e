"""Verdicts on single walls, from rays cast in scenes in which the truth is known."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.plans.elements import PlannedElement
from data.scene_graph import SceneGraph
from sgslam.as_built.elements import ElementVerdict, element_verdicts
from sgslam.as_built.elements.files import PICTURES, picture_of, write_elements
from sgslam.as_built.elements.sightings import View
from sgslam.as_built.elements.tolerance_classes import angle_compliance, angle_limit, loa_class, parse_length

PLAN = SceneGraph("bim", (), (), (), ())
SEEN, HIDDEN = "wall", "hidden"
SHARED = 0.004  # m


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> NDArray[np.float64]:
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return np.array([corners[[q[0], q[i], q[i + 1]]] for q in quads for i in (1, 2)])


WALL = _box((3.0, -3.0, 0.0), (3.2, 3.0, 2.6))
FAR = _box((6.0, -9.0, 0.0), (6.2, 9.0, 2.6))  # behind the wall
BEYOND = _box((9.0, -3.0, 0.0), (9.2, 3.0, 2.6))  # hidden by the far wall
ELEMENTS = [
    PlannedElement(name, "IfcWall", name, "", "solid", body)
    for name, body in ((SEEN, WALL), ("far", FAR), (HIDDEN, BEYOND))
]


def _views(*built: NDArray[np.float64], count: int = 6) -> list[View]:
    """Views from x = 0 of what stands, with 8 mm of noise."""
    scene, rng = TriangleScene(np.concatenate(built)), np.random.default_rng(0)
    y, z = np.meshgrid(np.linspace(-1.0, 1.0, 80), np.linspace(-0.3, 0.4, 16))
    rays = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    views = []
    for k in range(count):
        T = np.eye(4)
        T[:3, 3] = 0.0, 0.3 * k - 0.75, 1.2
        ranges = scene.distances(T[:3, 3], rays)
        met = np.isfinite(ranges)
        ranges = ranges[met] + rng.normal(0.0, 0.008, met.sum())
        views.append(View((ranges[:, None] * rays[met]).astype(np.float32), T, 0.002, 0.0005))
    return views


def _verdict(views: list[View], tolerance: float = 0.01, name: str = SEEN) -> ElementVerdict:
    return next(v for v in element_verdicts(ELEMENTS, views, PLAN, tolerance, SHARED) if v.global_id == name)


@pytest.mark.parametrize("shift", [0.2, -0.03, 0.03])
def test_a_wall_that_stands_elsewhere_is_moved_by_what_it_is_moved(shift: float) -> None:
    found = _verdict(_views(np.add(WALL, [shift, 0.0, 0.0]), FAR))
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    assert found.offset_m * found.direction[0] == pytest.approx(shift, abs=0.006)


def test_within_the_tolerance_it_is_as_planned() -> None:
    views = _views(np.add(WALL, [0.03, 0.0, 0.0]), FAR)
    assert _verdict(views, 0.05).verdict == "as planned"
    assert _verdict(_views(WALL, FAR)).verdict == "as planned"


@pytest.mark.parametrize(
    ("shift", "sigma", "told", "conclusive"),
    [
        (0.03, 0.02, "uncertain", False),
        (0.0, 0.02, "uncertain", False),
        (0.015, 0.006, "moved", False),
        (0.006, 0.006, "as planned", False),
        (0.1, 0.02, "moved", True),
    ],
)
def test_the_likelier_side_of_the_tolerance_is_told_and_whether_it_is_sure(
    shift: float, sigma: float, told: str, conclusive: bool
) -> None:
    views = [replace(view, sigma=sigma) for view in _views(np.add(WALL, [shift, 0.0, 0.0]), FAR)]
    found = _verdict(views)
    assert (found.verdict, found.conclusive) == (told, conclusive)


def test_seen_through_is_absent_and_hidden_is_not_seen() -> None:
    assert _verdict(_views(FAR)).verdict == "absent"
    assert _verdict(_views(WALL, FAR), name=HIDDEN).verdict == "not seen"
    assert _verdict(_views(FAR, count=2)).verdict == "not seen"


@pytest.mark.parametrize(("nearest", "furthest"), [(0.05, 0.14), (-1.5, -0.45)])
def test_a_wall_that_no_ray_passes_is_not_absent(nearest: float, furthest: float) -> None:
    """What is met lies centimetres behind it, where its end is embedded in others, or well before it."""
    views = []
    for k, view in enumerate(_views(WALL, FAR)):
        ranges = np.linalg.norm(view.points, axis=1, keepdims=True)
        behind = np.random.default_rng(k).uniform(nearest, furthest, ranges.shape)
        views.append(replace(view, points=(view.points * (1 + behind / ranges)).astype(np.float32)))
    assert _verdict(views).verdict in ("uncertain", "not seen", "moved")


def test_a_shelf_before_a_wall_does_not_move_it() -> None:
    shelf = _box((2.8, -1.0, 0.0), (2.9, 1.0, 1.6))
    assert _verdict(_views(WALL, shelf, FAR)).verdict == "as planned"
    whole = _box((2.8, -3.0, 0.0), (2.9, 3.0, 2.6))
    assert _verdict(_views(WALL, whole, FAR)).verdict != "moved"


@pytest.mark.parametrize(("half_width", "told"), [(0.4, "moved"), (0.8, "uncertain")])
def test_of_what_is_mostly_hidden_a_small_part_does_not_say_that_it_is_moved(half_width: float, told: str) -> None:
    """A screen in the middle of the room, before a wall that is 3 cm off; the rays spread over 1 m to either side."""
    screen = _box((1.0, -2.0, 0.0), (1.1, half_width, 2.6))
    moved = WALL + np.array([-0.03, 0.0, 0.0])
    assert _verdict(_views(moved, screen, FAR)).verdict == told


def test_the_files_have_a_row_for_each_element(tmp_path: Path) -> None:
    verdicts = element_verdicts(ELEMENTS, _views(WALL, FAR), PLAN, 0.01, SHARED)
    verdicts[0] = replace(verdicts[0], name="=1+1")
    write_elements(tmp_path, verdicts, 0.01)
    rows = list(csv.DictReader((tmp_path / "elements.csv").open()))
    assert [row["GlobalId"] for row in rows] == [SEEN, "far", HIDDEN] and rows[0]["name"] == "'=1+1"
    told = json.loads((tmp_path / "elements.json").read_text())
    assert told["counts"]["not seen"] == 1
    assert sorted(map(tuple, told["elements"][0]["outline"])) == [(3.0, -3.0), (3.0, 3.0), (3.2, -3.0), (3.2, 3.0)]
    assert rows[0]["direction (x y z)"] == "1.000 0.000 0.000" and rows[2]["direction (x y z)"] == ""
    assert rows[0]["LOA"] == told["elements"][0]["loa"] == "LOA30" and rows[0]["DIN 18202 limit (m)"] == "0.012"
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [office] is not installed")
    sheet = openpyxl.load_workbook(tmp_path / "elements.xlsx").active
    assert sheet.max_row == 4 and [cell.value for cell in sheet[2]][6:12:4] == ["as planned", "LOA30"]


def test_a_picture_that_is_there_is_linked(tmp_path: Path) -> None:
    (tmp_path / PICTURES).mkdir()
    (tmp_path / picture_of("far")).write_bytes(b"png")
    write_elements(tmp_path, element_verdicts(ELEMENTS, _views(WALL, FAR), PLAN, 0.01, SHARED), 0.01)
    rows = list(csv.DictReader((tmp_path / "elements.csv").open()))
    assert [row["picture"] for row in rows] == ["", "heat_maps/far.png", ""]
    assert picture_of("../x") == "heat_maps/___x.png"
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [office] is not installed")
    sheet = openpyxl.load_workbook(tmp_path / "elements.xlsx").active
    assert [row[-1].hyperlink and row[-1].hyperlink.target for row in sheet] == [None, None, "heat_maps/far.png", None]


@pytest.mark.parametrize("text", ["15mm", "0.015", "15 mm", "1.5cm", "0.015 m"])
def test_a_tolerance_is_a_length(text: str) -> None:
    assert parse_length(text) == pytest.approx(0.015)


@pytest.mark.parametrize("text", ["15", "-1mm", "0", "mm", "15 inches", "nan", "1,5cm", "0.9mm", "201mm"])
def test_another_tolerance_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="--tolerance"):
        parse_length(text)


def test_levels_of_accuracy_are_told_at_95_percent() -> None:
    """The specification's ranges end at 1, 5, 15 and 50 mm."""
    assert [loa_class(sigma) for sigma in (0.0005, 0.0025, 0.0026, 0.0075, 0.025, 0.026)] == [
        "LOA50", "LOA40", "LOA30", "LOA30", "LOA20", "LOA10",
    ]  # fmt: skip


def test_the_level_is_that_of_the_measurement_not_of_the_offset() -> None:
    offset = np.add(WALL, [0.03, 0.0, 0.0])
    exact, rough = _views(offset, FAR), [replace(view, sigma=0.02) for view in _views(offset, FAR)]
    assert [_verdict(views).loa for views in (exact, rough)] == ["LOA30", "LOA20"]
    assert _verdict(_views(WALL, FAR), name=HIDDEN).loa is None


def test_limits_of_din_18202_grow_with_the_length() -> None:
    assert [angle_limit(m) for m in (0.4, 1.0, 2.9, 4.0, 15.0, 30.0, 31.0)] == [
        0.003, 0.006, 0.008, 0.012, 0.016, 0.020, 0.030,
    ]  # fmt: skip
    assert [angle_compliance(d, 0.003, 0.012) for d in (0.0, -0.02, 0.011, -0.017)] == [
        "kept", "exceeded", "uncertain", "uncertain",
    ]  # fmt: skip


def _turned(body: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Counter-clockwise from above, about the middle of the wall."""
    c, s = np.cos(angle), np.sin(angle)
    return (body - [3.1, 0.0, 0.0]) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [3.1, 0.0, 0.0]


@pytest.mark.parametrize("angle", [0.01, -0.01])
def test_a_turned_wall_breaks_the_limit_for_its_length(angle: float) -> None:
    """6 m, turned by 10 mrad: its ends lie 60 mm apart across, of which DIN 18202 allows 12."""
    found = _verdict(_views(_turned(WALL, angle), FAR))
    assert found.turn_rad is not None and found.turn_sigma_rad is not None
    assert found.turn_rad == pytest.approx(angle, abs=2 * found.turn_sigma_rad)
    assert (found.din_18202, found.din_18202_limit_m) == ("exceeded", 0.012)


def test_a_turn_that_headings_could_make_breaks_no_limit() -> None:
    views = [replace(view, sigma_heading=0.01) for view in _views(_turned(WALL, 0.01), FAR)]
    assert _verdict(views).din_18202 == "uncertain"
    lost = [replace(view, sigma_heading=np.inf) for view in views]
    assert _verdict(lost).turn_rad is None and _verdict(lost).verdict == _verdict(views).verdict


def test_only_walls_have_a_limit() -> None:
    slab = [replace(element, ifc_class="IfcSlab") for element in ELEMENTS]
    found = element_verdicts(slab, _views(WALL, FAR), PLAN, 0.01, SHARED)[0]
    assert found.verdict == "as planned" and found.din_18202 is None and found.din_18202_limit_m is None
