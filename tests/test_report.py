"""The report and the plan: what is drawn where, names escaped, and nothing loaded from elsewhere."""

import dataclasses
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from data.poses import xyzquat_to_poses
from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.plan_drawing import MAX_VERTICES, ReportData, plan_drawing, robots_floor
from sgslam.plan_view import write_plan_png
from sgslam.report import report_html, write_report

HOSTILE = "<script>alert('x')</script> & \"Söhne\" $\\frac$"
ORIGIN = np.array([3_468_000.0, 5_427_000.0])  # a site's place in a national grid
SEVEN = [12.0, 3.0, 4.0, 0.0, 0.0, np.sin(0.3), np.cos(0.3)]  # x y z and a turn of 0.6 rad about z


def rectangle(room: str, x: float, y: float, dx: float, dy: float, floor: str) -> list[WallSurface]:
    sides = [((x + dx / 2, y), (0.0, 1.0), dx), ((x + dx / 2, y + dy), (0.0, -1.0), dx),
             ((x, y + dy / 2), (1.0, 0.0), dy), ((x + dx, y + dy / 2), (-1.0, 0.0), dy)]  # fmt: skip
    return [
        WallSurface(f"{room}.{i}", room, centre, normal, length, floor)
        for i, (centre, normal, length) in enumerate(sides)
    ]


def building(rooms_a_side: int = 4, storeys: int = 2) -> SceneGraph:
    """Storeys 3.5 m apart: a corridor along x with rooms of several widths on both its sides."""
    rooms, walls = [], []
    for k in range(storeys):
        x = 0.0
        floor = f"F{k}"
        for i in range(rooms_a_side):
            width = 3.0 + (i * 7 % 4)
            for side, y, depth in (("n", 2.4, 5.0), ("s", -5.2, 5.0)):
                name = f"r{k}{side}{i}"
                corners = ((x, y), (x + width, y), (x + width, y + depth), (x, y + depth))
                centre = (x + width / 2, y + depth / 2)
                rooms.append(Room(name, centre, floor, f"Office {k}{i}{side}", corners))
                walls += rectangle(name, x, y, width, depth, floor)
            x += width + 0.2
        corners = ((0.0, 0.0), (x, 0.0), (x, 2.2), (0.0, 2.2))
        rooms.append(Room(f"c{k}", (x / 2, 1.1), floor, "Corridor", corners))
        walls += rectangle(f"c{k}", 0, 0, x, 2.2, floor)
    floors = tuple(Floor(f"F{k}", f"Storey {k}", 3.5 * k) for k in range(storeys))
    return SceneGraph("bim", tuple(rooms), tuple(walls), (), floors)


def into_map(xy: tuple[float, float]) -> tuple[float, float]:
    T_map_bim = np.linalg.inv(xyzquat_to_poses(SEVEN))
    x, y, _, _ = T_map_bim @ [*xy, 4.0, 1.0]
    return float(x), float(y)


def mapped(a_graph: SceneGraph, floor: str = "F1") -> SceneGraph:
    """The storey as a robot maps it, with ids of its own and one cupboard that no plan knows."""
    yaw = -0.6
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    seen = a_graph.on_floor(floor)
    rooms = [
        Room(f"S{r.id}", into_map(r.centroid), None, f"room {i}", tuple(into_map(p) for p in r.polygon or ()))
        for i, r in enumerate(seen.rooms)
    ]
    walls = []
    for w in seen.wall_surfaces:
        nx, ny = (R @ w.normal).tolist()
        walls.append(WallSurface(f"S{w.id}", f"S{w.room}", into_map(w.centroid), (nx, ny), w.length))
    walls.append(WallSurface("Scupboard", None, into_map((6.0, -3.0)), (1.0, 0.0), None))
    return SceneGraph("map", tuple(rooms), tuple(walls))


def drive(count: int = 500) -> Trajectory:
    """In the BIM frame, 0.5 m above the floor at 3.5 m: along the corridor and into a room."""
    s = np.linspace(0, 1, count)
    rows = np.zeros((count, 7))
    rows[:, 0], rows[:, 2], rows[:, 6] = 1 + 14 * s, 4.0, 1
    rows[:, 1] = 1.1 + 0.3 * np.sin(20 * s) + 3.5 * np.clip((s - 0.8) / 0.2, 0, 1)
    return Trajectory(np.arange(count) * 100_000_000, xyzquat_to_poses(rows))


def sample(count: int = 500, rooms_a_side: int = 4) -> ReportData:
    """An anchored run: every surface of the storey matched, the odometry, in its own frame, turning away."""
    a_graph = building(rooms_a_side)
    s_graph = mapped(a_graph)
    truth = drive(count)
    T_bim_map = xyzquat_to_poses(SEVEN)
    trajectory = truth.transformed(np.linalg.inv(T_bim_map))
    matches = {
        "status": "unique", "reason": "one motion explains 9 rooms", "floor": "F1", "T_a_s": [0.6, 12.0, 3.0],
        "rooms": [[r.id, r.id[1:], 0.97] for r in s_graph.rooms],
        "wall_surfaces": [[w.id, w.id[1:], 0.9] for w in s_graph.wall_surfaces if w.id != "Scupboard"],
        "hypotheses": [
            {"score": 31.5, "T_a_s": [0.6, 12.0, 3.0], "floor": "F1", "rooms": [["Sc1", "c1"]]},
            {"score": 30.9, "T_a_s": [3.74, 5.0, -3.0], "floor": "F0", "rooms": []},
        ],
    }  # fmt: skip
    metrics = {
        "anchored": True, "reason": "anchored to Storey 1 with 9 rooms and 36 wall surfaces",
        "T_bim_map": SEVEN, "scans": count, "scans_skipped": 1, "keyframes": 61,
        "rooms": len(s_graph.rooms), "wall_surfaces": len(s_graph.wall_surfaces), "first_anchor_s": 14.2,
        "seconds": {"total": 9.31, "reading": 0.12, "odometry": 5.2, "surfaces": 1.1, "rooms": 0.44,
                    "matching": 0.9, "optimisation": 0.61, "bim": 0.8, "report": 0.14},
        "accuracy": {"rmse_bim_m": 0.0123, "max_bim_m": 0.041, "yaw_rmse_bim_deg": 0.11,
                     "rmse_odometry_aligned_m": 0.084, "matched_poses": count, "total_poses": count},
    }  # fmt: skip
    half_turn = np.linspace(0, 0.05, count)
    turn = np.zeros((count, 7))
    turn[:, 5], turn[:, 6] = np.sin(half_turn), np.cos(half_turn)
    start = trajectory.poses[0]
    odometry = Trajectory(
        trajectory.stamps_ns, xyzquat_to_poses(turn) @ np.linalg.inv(start) @ trajectory.poses
    )
    return ReportData(a_graph, s_graph, trajectory, odometry, truth, T_bim_map, matches, metrics)


def not_anchored(status: str) -> ReportData:
    data = sample()
    matches = dict(data.matches or {}, status=status, reason="two places fit alike")
    if status == "none":
        matches |= {"rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None, "hypotheses": []}
    metrics = data.metrics | {"anchored": False, "reason": "two places fit alike", "T_bim_map": None}
    return dataclasses.replace(data, T_bim_map=None, matches=matches, metrics=metrics)


class Page(HTMLParser):
    """Counts a page's elements by tag, and the children of the plan's layers; keeps its visible text."""

    VOID = frozenset({"meta", "input", "br"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.layers: Counter[tuple[str, str]] = Counter()
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.open: list[tuple[str, str]] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {k: v or "" for k, v in attrs}
        self.tags[tag] += 1
        self.attributes += values.items()
        if any(kind == "plan" for _, kind in self.open):
            layer = next((kind for _, kind in reversed(self.open) if kind.startswith("layer-")), "")
            self.layers[layer, tag] += 1
        if tag not in self.VOID:
            self.open.append((tag, values.get("id") or values.get("class", "")))

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop()[0] == tag, f"</{tag}> closes nothing"

    def handle_data(self, text: str) -> None:
        if self.open and self.open[-1][0] not in ("script", "style"):
            self.text += text + "\n"


def test_the_page_shows_every_surface_room_and_match() -> None:
    data = sample()
    page = Page(report_html(data))
    assert not page.open
    assert page.layers["layer-bim-walls", "polyline"] == 36  # one storey of two
    assert page.layers["layer-walls-matched", "polyline"] == 36
    assert page.layers["layer-walls-unmatched", "polyline"] == 1
    assert page.layers["layer-matches", "polyline"] == 36
    assert page.layers["layer-map-rooms", "polygon"] == page.layers["layer-rooms-matched", "polygon"] == 9
    assert page.layers["layer-odometry", "polyline"] == page.layers["layer-truth", "polyline"] == 1
    assert page.layers["layer-trajectory", "polyline"] == 3  # with its start and its end
    for text in ("Anchored", "Storey 1", "1.2 cm", "8.4 cm", "Office 12n", "room 4", "34.38°",
                 "12.000, 3.000, 4.000 m", "odometry", "5.2 s", "9.3 s", "0.97"):  # fmt: skip
        assert text in page.text
    assert "Hypotheses" not in page.text


@pytest.mark.parametrize("status", ["unique", "ambiguous", "none"])
def test_the_page_needs_nothing_but_itself(status: str) -> None:
    html = report_html(sample() if status == "unique" else not_anchored(status))
    assert not re.search(r"(?i)https?:|//[a-z]|url\(|@import|\bsrc=|\bhref=|fetch\(|XMLHttpRequest", html)
    assert not re.search(r"\bnan\b|\binf\b|None|\[\]", html)
    assert "default-src 'none'" in html and html.count("<script>") == 1


def test_hostile_names_are_text() -> None:
    data = sample()
    a = building()
    a_rooms = tuple(dataclasses.replace(r, name=HOSTILE) for r in a.rooms)
    a_walls = tuple(dataclasses.replace(w, source=HOSTILE) for w in a.wall_surfaces)
    floors = (Floor("F0", HOSTILE, 0.0), Floor("F1", HOSTILE, 3.5))
    a_graph = dataclasses.replace(a, rooms=a_rooms, wall_surfaces=a_walls, floors=floors)
    s_rooms = tuple(dataclasses.replace(r, name=HOSTILE) for r in data.s_graph.rooms)
    matches = dict(data.matches or {}, status="ambiguous", reason=HOSTILE)
    metrics = data.metrics | {"reason": HOSTILE, "seconds": {HOSTILE: 1.0}}
    s_graph = dataclasses.replace(data.s_graph, rooms=s_rooms)
    hostile = dataclasses.replace(data, a_graph=a_graph, s_graph=s_graph, matches=matches, metrics=metrics)
    page = Page(report_html(hostile))
    plain = Page(report_html(dataclasses.replace(data, matches=matches)))
    assert page.tags["script"] == 1 and page.layers == plain.layers
    assert page.text.count(HOSTILE) > 40


def test_the_map_lies_on_the_plan_when_anchored() -> None:
    drawing = plan_drawing(sample())
    assert drawing.heading == "Storey 1"
    for ours, planned in zip(drawing.map_walls, drawing.bim_walls, strict=False):
        assert np.allclose(ours.ends, planned.ends, atol=1e-9)
    assert np.allclose(drawing.match_lines[:, 0], drawing.match_lines[:, 1], atol=1e-9)
    assert np.allclose(drawing.paths["trajectory"], drawing.paths["truth"], atol=1e-9)
    away = np.linalg.norm(drawing.paths["odometry"] - drawing.paths["truth"], axis=1)
    assert away[0] < 1e-9 and away[-1] > 0.3
    low, high = drawing.bounds()
    assert np.allclose(low, [0, -5.2]) and high[1] == pytest.approx(7.4)


def test_an_ambiguous_match_is_shown_as_a_guess() -> None:
    data = not_anchored("ambiguous")
    drawing = plan_drawing(data)
    assert "not committed" in drawing.heading
    assert np.allclose(drawing.map_walls[0].ends, drawing.bim_walls[0].ends, atol=1e-9)
    page = Page(report_html(data))
    for text in ("Not anchored", "two places fit alike", "Hypotheses", "31.50", "Storey 0", "214.3°"):
        assert text in page.text


def test_a_map_without_a_place_lies_beside_the_plan() -> None:
    drawing = plan_drawing(not_anchored("none"))
    assert "beside" in drawing.heading and not len(drawing.match_lines)
    right_of_plan = max(w.ends[:, 0].max() for w in drawing.bim_walls)
    assert min(w.ends[:, 0].min() for w in drawing.map_walls if w.title[:5] != "Scupb") > right_of_plan - 3
    assert not any(w.matched for w in drawing.map_walls)


def test_without_a_bim_the_map_is_shown_alone() -> None:
    data = sample()
    metrics = data.metrics | {"anchored": False, "reason": "no BIM was given", "T_bim_map": None}
    alone = dataclasses.replace(data, a_graph=None, T_bim_map=None, matches=None, truth=None, metrics=metrics)
    page = Page(report_html(alone))
    assert page.layers["layer-bim-walls", "polyline"] == page.layers["layer-matches", "polyline"] == 0
    assert page.layers["layer-walls-unmatched", "polyline"] == 37
    assert "Matched rooms" not in page.text and "Not anchored" in page.text


def test_a_run_that_saw_nothing_still_has_its_report(tmp_path: Path) -> None:
    standing = Trajectory(np.array([0]), np.eye(4)[None])
    empty = ReportData(None, SceneGraph("map"), standing, standing, None, None, None,
                       {"anchored": False, "reason": "no BIM was given"})  # fmt: skip
    assert not Page(report_html(empty)).open
    write_plan_png(empty, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 1000


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
    floor = robots_floor(dataclasses.replace(sample(), **change))
    assert floor is not None and floor.id == expected


def test_long_runs_in_large_buildings_far_from_the_origin_stay_small_and_sharp(tmp_path: Path) -> None:
    data = sample(count=20_000, rooms_a_side=60)
    far = np.eye(4)
    far[:2, 3] = ORIGIN
    a = data.a_graph
    assert a is not None

    def moved(xy: tuple[float, float]) -> tuple[float, float]:
        return xy[0] + ORIGIN[0], xy[1] + ORIGIN[1]

    rooms = tuple(
        dataclasses.replace(r, centroid=moved(r.centroid), polygon=tuple(moved(p) for p in r.polygon or ()))
        for r in a.rooms
    )
    walls = tuple(dataclasses.replace(w, centroid=moved(w.centroid)) for w in a.wall_surfaces)
    data = dataclasses.replace(
        data, a_graph=dataclasses.replace(a, rooms=rooms, wall_surfaces=walls),
        T_bim_map=far @ data.T_bim_map, truth=None,
    )  # fmt: skip
    drawing = plan_drawing(data)
    assert len(drawing.bim_walls) == 484
    path = drawing.paths["trajectory"]
    assert len(path) == MAX_VERTICES
    last = data.T_bim_map @ data.trajectory_map.poses[-1]  # type: ignore[operator]
    assert np.allclose(path[-1], last[:2, 3])
    write_report(data, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text()
    assert len(html) < 1_000_000
    drawn = [float(v) for points in re.findall(r'points="([^"]*)"', html) for v in re.split("[ ,]", points)]
    assert max(map(abs, drawn)) < 1000
    write_plan_png(data, tmp_path / "plan.png")


def test_plan_png_shows_all_its_colours(tmp_path: Path) -> None:
    data = sample()
    write_plan_png(data, tmp_path / "plan.png")
    image = matplotlib.image.imread(tmp_path / "plan.png")
    assert image.shape[1] > 1200
    for color in ("#a3a9b2", "#0f8a7b", "#d96c1a", "#2563eb"):
        rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        assert (np.abs(image[..., :3] - rgb).max(axis=-1) < 0.02).sum() > 50, color
    assert [p.name for p in tmp_path.iterdir()] == ["plan.png"]
