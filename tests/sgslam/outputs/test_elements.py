"""Verdicts on single walls, from rays cast in scenes in which the truth is known, and the tables of them."""

import csv
import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from two_rooms_seen import Floats, assessed, box

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.plans.bodies import PANE, PlannedElement
from sgslam.as_built.elements import ElementVerdict
from sgslam.as_built.elements.files import PICTURES, picture_of, write_elements
from sgslam.as_built.elements.rays import View
from sgslam.as_built.elements.tolerance_classes import angle_limit, compliance, loa_class, parse_length

WALL = box((3.0, -3.0, 0.0), (3.2, 3.0, 2.6))
QUARTER = box((3.0, -3.0, 0.0), (3.2, -1.5, 2.6))  # of it stands
FAR = box((6.0, -9.0, 0.0), (6.2, 9.0, 2.6))  # behind the wall
BODIES = {"wall": WALL, "far": FAR, "hidden": box((9.0, -3.0, 0.0), (9.2, 3.0, 2.6))}  # by the far wall
ELEMENTS = [PlannedElement(name, "IfcWall", name, "", "solid", body) for name, body in BODIES.items()]


def views_of(*built: Floats, count: int = 6) -> list[View]:
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
        views.append(View((ranges[:, None] * rays[met]).astype(np.float32), T, np.full(3, 0.002), 0.0005))
    return views


def judged(views: list[View], tolerance: float = 0.01) -> dict[str, ElementVerdict]:
    return {own.global_id: own for own in assessed(ELEMENTS, views, tolerance).elements}


def wall(views: list[View], tolerance: float = 0.01) -> ElementVerdict:
    return judged(views, tolerance)["wall"]


@pytest.mark.parametrize(
    ("shift", "sigma", "tolerance", "told", "conclusive"),
    [
        (-0.03, 0.002, 0.05, "as planned", True),
        (-0.03, 0.002, 0.01, "moved", True),
        (0.2, 0.002, 0.01, "moved", True),
        (0.022, 0.02, 0.01, "uncertain", False),  # neither is by far likelier
        (0.045, 0.02, 0.01, "moved", False),
        (0.015, 0.006, 0.01, "moved", False),
        (0.006, 0.006, 0.01, "as planned", False),
    ],
)
def test_the_likelier_side_of_the_tolerance_is_told_and_whether_it_is_sure(
    shift: float, sigma: float, tolerance: float, told: str, conclusive: bool
) -> None:
    views = [replace(view, sigma=np.full(3, sigma)) for view in views_of(np.add(WALL, [shift, 0.0, 0.0]), FAR)]
    found = wall(views, tolerance)
    assert (found.verdict, found.conclusive) == (told, conclusive)
    assert found.offset_m is not None and found.direction is not None
    assert found.offset_m * found.direction[0] == pytest.approx(shift, abs=0.006)


def test_seen_through_is_absent_and_hidden_is_not_seen() -> None:
    assert wall(views_of(FAR)).verdict == "absent"
    hidden = judged(views_of(WALL, FAR))["hidden"]
    assert hidden.verdict == "not seen" and hidden.loa is None
    assert wall(views_of(FAR, count=2)).verdict == "not seen"


@pytest.mark.parametrize(("nearest", "furthest"), [(0.05, 0.14), (-1.5, -0.45)])
def test_a_wall_that_no_ray_passes_is_not_absent(nearest: float, furthest: float) -> None:
    """What is met lies centimetres behind it, where its end is embedded in others, or well before it."""
    views = []
    for k, view in enumerate(views_of(WALL, FAR)):
        ranges = np.linalg.norm(view.points, axis=1, keepdims=True)
        behind = np.random.default_rng(k).uniform(nearest, furthest, ranges.shape)
        views.append(replace(view, points=(view.points * (1 + behind / ranges)).astype(np.float32)))
    assert wall(views).verdict in ("uncertain", "not seen", "moved")


@pytest.mark.parametrize(
    ("length", "built", "opaque", "glazed"),
    [
        (1.0, [], "absent", "uncertain"),  # it may be one pane
        (6.0, [], "absent", "absent"),  # more panes than a wall has
        (6.0, [QUARTER], "uncertain", "as planned"),  # between windows
        (3.0, [QUARTER], "absent", "uncertain"),  # its end is no moved wall
    ],
)
def test_what_may_be_of_glass_is_absent_only_where_much_of_it_is_seen_through(
    length: float, built: list[Floats], opaque: str, glazed: str
) -> None:
    own = replace(ELEMENTS[0], triangles=WALL * [1.0, length / 6.0, 1.0])
    views = views_of(*built, FAR)
    for expected, planned in ((opaque, own), (glazed, replace(own, pane=PANE))):
        assert assessed([planned], views).elements[0].verdict == expected


@pytest.mark.parametrize(("half_width", "told"), [(0.4, "moved"), (0.8, "uncertain")])
def test_of_what_is_mostly_hidden_a_small_part_does_not_say_that_it_is_moved(half_width: float, told: str) -> None:
    """A screen in the middle of the room, before a wall that is 3 cm off; the rays spread over 1 m to either side."""
    screen = box((1.0, -2.0, 0.0), (1.1, half_width, 2.6))
    assert wall(views_of(WALL + np.array([-0.03, 0.0, 0.0]), screen, FAR)).verdict == told


@pytest.mark.parametrize(
    ("built", "count", "place", "progress", "tolerance"),
    [
        ([WALL], 6, 0.0, "installed", "within"),
        ([WALL + np.array([-0.03, 0.0, 0.0])], 6, 0.0, "installed", "outside"),
        ([], 6, 0.0, "not found", None),
        ([WALL], 2, 0.0, "not enough data", None),
        ([box((1.0, -3.0, 0.0), (1.1, 3.0, 2.6))], 6, 0.0, "occluded", None),  # by what is not planned
        ([WALL], 6, 3.5, "occluded", None),  # by what is planned before it
        ([WALL], 6, -6.0, "no data", None),  # behind the sensor
        ([WALL], 6, 12.0, "no data", None),  # too far away
    ],
)
def test_progress_is_why_an_element_is_not_known_to_be_there(
    built: list[Floats], count: int, place: float, progress: str, tolerance: str | None
) -> None:
    own = replace(ELEMENTS[0], global_id="own", triangles=WALL + np.array([place, 0.0, 0.0]))
    found = assessed([own, *(ELEMENTS[:1] if place > 0 else [])], views_of(*built, FAR, count=count)).elements[0]
    assert (found.progress, found.tolerance) == (progress, tolerance)
    assert found.conclusive == (progress in ("installed", "not found"))


@pytest.mark.parametrize("shift", [0.0, 0.2])
def test_coverage_is_of_the_face_and_seen_of_what_was_in_view(shift: float) -> None:
    """The rays meet z of 0.3 to 2.4 m, of 2.6, all along a wall of 6 m; or in half of the directions."""
    views = views_of(WALL + np.array([shift, 0.0, 0.0]), FAR)
    halves = [replace(view, points=view.points[view.points[:, 1] > -view.sensor[1]]) for view in views]
    for seen, share in ((views, 2.25 / 2.6), (halves, 2.25 / 2.6 / 2)):
        found = wall(seen)
        assert found.coverage == pytest.approx(share, abs=0.04) and found.seen > 0.95
    screen = box((2.0, 0.0, 0.0), (2.1, 3.0, 2.6))
    hidden = wall(views_of(WALL, screen, FAR))
    assert hidden.seen < 0.8 and hidden.coverage == pytest.approx(0.5 * 2.25 / 2.6, abs=0.1)


def test_doubt_about_what_was_measured_leaves_an_element_out_of_any_tolerance() -> None:
    screen = box((1.0, -3.0, 0.0), (1.1, 0.8, 2.6))
    found = wall(views_of(WALL + np.array([-0.03, 0.0, 0.0]), screen, FAR))
    assert (found.verdict, found.doubt, found.progress, found.tolerance) == (
        "uncertain", True, "occluded", "not conclusive",
    )  # fmt: skip


def test_the_files_have_a_row_for_each_element(tmp_path: Path) -> None:
    verdicts = list(judged(views_of(WALL, FAR)).values())
    verdicts[0] = replace(verdicts[0], name="=1+1")
    (tmp_path / PICTURES).mkdir()
    (tmp_path / picture_of("far")).write_bytes(b"png")
    assert Path(picture_of("../x")).parts == (PICTURES, "___x.png")
    write_elements(tmp_path, [asdict(own) for own in verdicts], 0.01)
    rows = list(csv.DictReader((tmp_path / "elements.csv").open()))
    assert [row["GlobalId"] for row in rows] == [*BODIES] and rows[0]["name"] == "'=1+1"  # no formula
    assert [row["picture"] for row in rows] == ["", picture_of("far"), ""]
    told = json.loads((tmp_path / "elements.json").read_text())
    assert told["counts"]["not seen"] == 1
    assert sorted(map(tuple, told["elements"][0]["outline"])) == [(3.0, -3.0), (3.0, 3.0), (3.2, -3.0), (3.2, 3.0)]
    columns = ("progress", "tolerance", "coverage")
    assert [rows[0][name] for name in columns] == [str(told["elements"][0][name]) for name in columns]
    assert rows[0]["progress"] == "installed" and rows[2]["tolerance"] == ""
    assert rows[0]["LOA"] == told["elements"][0]["loa"] == "LOA30" and rows[0]["DIN 18202 limit (m)"] == "0.012"
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [office] is not installed")
    sheet = openpyxl.load_workbook(tmp_path / "elements.xlsx").active
    assert sheet.max_row == 4 and {"as planned", "LOA30"} <= {cell.value for cell in sheet[2]}
    assert [bool(row[-1].hyperlink) for row in sheet] == [False, False, True, False]


def test_a_tolerance_is_a_length() -> None:
    assert [parse_length(text) for text in ("15mm", "0.015", "1.5cm", "0.015 m")] == pytest.approx([0.015] * 4)
    for text in ("-1mm", "15 inches", "nan", "0.9mm", "201mm"):
        with pytest.raises(UserError, match="--tolerance"):
            parse_length(text)


def test_limits_of_the_classes_are_those_of_their_standards() -> None:
    """USIBD's ranges end at 1, 5, 15 and 50 mm at 95 %; limits of DIN 18202 grow with the length."""
    sigmas = (0.0005, 0.0025, 0.0026, 0.0075, 0.025, 0.026)
    assert [loa_class(sigma)[-2:] for sigma in sigmas] == ["50", "40", "30", "30", "20", "10"]
    lengths, limits = (0.4, 1.0, 2.9, 4.0, 15.0, 30.0, 31.0), [0.003, 0.006, 0.008, 0.012, 0.016, 0.020, 0.030]
    assert [angle_limit(metres) for metres in lengths] == limits
    kept = ["within", "outside", "not conclusive", "not conclusive"]
    assert [compliance(d, 0.003, 0.012) for d in (0.0, -0.02, 0.011, -0.017)] == kept


def test_a_turned_wall_breaks_the_limit_for_its_length() -> None:
    """6 m, turned by 10 mrad: its ends lie 60 mm apart across, of which DIN 18202 allows 12."""
    angle = -0.01
    c, s = np.cos(angle), np.sin(angle)
    turned = (WALL - [3.1, 0.0, 0.0]) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [3.1, 0.0, 0.0]
    views = views_of(turned, FAR)
    found = wall(views)
    assert found.turn_rad is not None and found.turn_sigma_rad is not None
    assert found.turn_rad == pytest.approx(angle, abs=2 * found.turn_sigma_rad)
    assert (found.din_18202, found.din_18202_limit_m) == ("outside", 0.012)
    loose = [replace(view, sigma_heading=0.01) for view in views]  # headings that could make the turn
    assert wall(loose).din_18202 == "not conclusive"
    assert wall([replace(view, sigma_heading=np.inf) for view in views]).turn_rad is None
