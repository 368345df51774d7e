"""The report's page: what it says and shows, names escaped, and nothing loaded from elsewhere."""

import base64
import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from report_samples import HOSTILE, ORIGIN, Page, building, not_anchored, sample

from data.scene_graph import Floor, SceneGraph
from data.trajectory import Trajectory
from sgslam.report import ReportData
from sgslam.report.drawn_paths import MAX_VERTICES
from sgslam.report.page import report_html, write_report
from sgslam.report.plan_drawing import plan_drawing
from sgslam.report.plan_png import write_plan_png


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
    for text in ("Anchored", "Storey 1", "12.3 mm", "84.0 mm", "Office 12n", "room 4", "34.38°",
                 "12.000, 3.000, 4.000 m", "odometry", "5.2 s", "9.3 s", "0.97"):  # fmt: skip
        assert text in page.text
    assert "Hypotheses" not in page.text


@pytest.mark.parametrize("status", ["unique", "ambiguous", "none"])
def test_the_page_needs_nothing_but_itself(status: str) -> None:
    html = report_html(sample() if status == "unique" else not_anchored(status))
    assert not re.search(r"(?i)https?:|//[a-z]|url\(|@import|\bsrc=|\bhref=|fetch\(|XMLHttpRequest", html)
    page = Page(html)
    assert not re.search(r"\bnan\b|\binf\b|None|\[\]|undefined", page.text)


def test_the_policy_lets_in_only_the_pages_own_script_and_style() -> None:
    html = report_html(sample())
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None and "unsafe" not in policy[1] and "default-src 'none'" in policy[1]
    for tag in ("script", "style"):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy[1]
    assert not re.search(r"<[^>]* (style|on\w+)=", html)  # neither would work under it


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
    deviations = [d | {"source": HOSTILE} for d in data.deviations]
    hostile = dataclasses.replace(
        data, a_graph=a_graph, s_graph=s_graph, matches=matches, metrics=metrics, deviations=deviations
    )
    page = Page(report_html(hostile))
    plain = Page(report_html(dataclasses.replace(data, metrics=data.metrics | {"seconds": {"all": 1.0}})))
    assert page.tags == plain.tags and page.layers == plain.layers
    assert page.text.count(HOSTILE) > 60
    guess = dataclasses.replace(hostile, T_bim_map=None)
    page, plain = Page(report_html(guess)), Page(report_html(dataclasses.replace(data, T_bim_map=None)))
    assert page.tags["script"] == plain.tags["script"] and page.tags["figure"] == 2
    assert page.layers == plain.layers


def test_an_ambiguous_match_is_shown_as_a_guess() -> None:
    data = not_anchored("ambiguous")
    drawing = plan_drawing(data)
    assert "not accepted" in drawing.heading
    assert np.allclose(drawing.map_walls[0].ends, drawing.bim_walls[0].ends, atol=1e-9)
    page = Page(report_html(data))
    said = ("Not anchored", "two places fit alike", "no hypothesis was accepted")
    told = ("Hypotheses", "31.5", "Storey 0", "\N{MINUS SIGN}145.7°", "1 matched room;", "0 matched rooms;")
    for text in (*said, *told):
        assert text in page.text
    assert page.tags["figure"] == 2


def test_what_is_not_anchored_or_not_sound_is_shown() -> None:
    data, signal = sample(), {"value": 7.0, "limit": 1, "ok": False}
    within = {"value": 0.0134, "limit": 0.05, "ok": True}
    found = {"anchored_share": 0.925, "quality": {"planned_walls_crossed": signal, "lost_scans": within}}
    page = Page(report_html(dataclasses.replace(data, metrics=data.metrics | found)))
    assert "Anchored in part: 92.5 % of the scans" in page.text
    assert page.text.count("outside its limit") == 1
    assert "planned walls that the path crosses\n7\nat most 1\n" in page.text
    assert "lost scans, share of all\n1.34 %\nat most 5 %\n" in page.text
    assert "Quality of the map" not in Page(report_html(data)).text


def test_without_a_bim_the_map_is_shown_alone() -> None:
    data = sample()
    judged = {"rmse_bim_m": None, "rmse_map_aligned_m": 0.0051, "rmse_odometry_aligned_m": 0.0046}
    metrics = data.metrics | {"anchored": False, "reason": "no plan was given", "T_bim_map": None, "accuracy": judged}
    alone = dataclasses.replace(
        data, a_graph=None, T_bim_map=None, matches=None, truth=None, metrics=metrics, deviations=[]
    )
    page = Page(report_html(alone))
    assert page.layers["layer-bim-walls", "polyline"] == page.layers["layer-matches", "polyline"] == 0
    assert page.layers["layer-walls-unmatched", "polyline"] == 37
    assert "Matched rooms" not in page.text and "Not anchored" not in page.text and "not matched" not in page.text
    assert re.search(r"5\.1 mm\s*RMSE of the trajectory, aligned", page.text)
    assert "Map only" in page.text and "no plan was given" in page.text


def test_a_run_that_saw_nothing_still_has_its_report(tmp_path: Path) -> None:
    standing = Trajectory(np.array([0]), np.eye(4)[None])
    empty = ReportData(None, SceneGraph("map"), standing, standing, None, None, None,
                       {"anchored": False, "reason": "no plan was given"}, [])  # fmt: skip
    page = Page(report_html(empty))
    assert not page.open and "no plan was given" in page.text
    write_plan_png(empty, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 1000


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
    (way,) = drawing.paths["trajectory"]
    path = way.points
    assert len(path) == MAX_VERTICES
    last = data.T_bim_map @ data.trajectory_map.poses[-1]  # type: ignore[operator]
    assert np.allclose(path[-1], last[:3, 3])
    write_report(data, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text()
    assert len(html) < 1_000_000
    drawn = [float(v) for points in re.findall(r'points="([^"]*)"', html) for v in re.split("[ ,]", points)]
    assert max(map(abs, drawn)) < 1100
    scene = json.loads(Page(html).inside["scene-data"])
    assert len(scene["walls"]) == 484 + 485
    numbers = [v for wall in scene["walls"] for v in wall[3:]] + scene["paths"]["trajectory"][0] + scene["keyframes"]
    assert all(isinstance(v, int) and abs(v) < 1_000_000 for v in numbers)
    write_plan_png(data, tmp_path / "plan.png")


def test_the_largest_deviations_are_listed() -> None:
    data = sample()
    page = Page(report_html(data))
    assert "4 of 38" in page.text  # with the wall that is not there, and the cupboard
    assert "Significant and largest deviations" in page.text
    for text in ("\N{MINUS SIGN}123.4 mm", "+45.0 mm", "absent", "extra", "guid-absent"):
        assert text in page.text
    assert page.text.index("guid-5\n") < page.text.index("guid-7\n") < page.text.index("guid-0\n")
    shown = [value for key, value in page.attributes if key == "data-shows" and value]
    drawn = {value for key, value in page.attributes if key == "data-wall"}
    assert len(shown) == 29 and set(shown) < drawn
    assert page.layers["layer-walls-matched", "polyline"] == 36
    assert "deviations" not in Page(report_html(not_anchored("ambiguous"))).text


def test_the_scene_holds_what_the_plan_shows() -> None:
    data = sample()
    scene = json.loads(Page(report_html(data)).inside["scene-data"])
    assert [wall[0] for wall in scene["walls"]].count("bim-walls") == 36
    looks = {wall[1] for wall in scene["walls"] if wall[0] == "walls-matched"}
    assert looks == {"band-as-planned", "band-back-3", "band-into-2"}
    centre = plan_drawing(data).centre()
    for wall, planned in zip(scene["walls"], plan_drawing(data).bim_walls, strict=False):
        assert np.allclose(np.reshape(wall[3:7], (2, 2)) / 1000 + centre, planned.ends, atol=5e-4)
        assert wall[7:] == [0, 2500]
    assert set(scene["paths"]) == {"trajectory", "odometry", "truth"}
    assert len(scene["keyframes"]) == 3 * 50 and scene["keyframes"][2] == 500  # mm above the floor
    assert len(scene["floors"]) == 9 and all(matched for matched, _ in scene["floors"])


def test_each_hypothesis_is_drawn_in_its_place() -> None:
    data = not_anchored("ambiguous")
    html = report_html(data)
    figures = re.findall(r"<figure>(.*?)</figure>", html, re.DOTALL)
    assert len(figures) == 2 and len(set(re.findall(r'<figure><svg viewBox="([^"]*)"', html))) == 1

    def segments(figure: str, layer: str) -> np.ndarray:
        (path,) = re.findall(f'layer-{layer}"><path d="([^"]*)"', figure)
        return np.array(re.findall(r"-?[\d.]+", path), float).reshape(-1, 4)

    planned = segments(figures[0], "bim-walls")
    placed = np.vstack([segments(figures[0], layer) for layer in ("walls-matched", "walls-unmatched")])
    assert len(planned) == 36 and len(placed) == 37
    for line in planned:  # the first hypothesis is the truth: each planned wall has a mapped one on it
        assert np.abs(placed - line).max(axis=1).min() < 0.011
    other = np.vstack([segments(figures[1], "walls-unmatched")])
    assert np.abs(other - placed).max() > 3
    assert len(segments(figures[0], "walls-matched")) == 4  # those of the room that it matches


def test_five_hypotheses_are_four_figures() -> None:
    data = not_anchored("ambiguous")
    matches = dict(data.matches or {})
    matches["hypotheses"] = [{"score": -s, "T_a_s": [0.1 * s, 0, 0], "floor": None, "rooms": []} for s in range(5)]
    page = Page(report_html(dataclasses.replace(data, matches=matches)))
    assert page.tags["figure"] == 4 and page.text.count("the plan\n") >= 4
    assert "None" not in page.text


def test_rooms_of_a_match_that_the_map_has_no_more_are_not_counted() -> None:
    data = sample()
    matches = dict(data.matches or {})
    matches["rooms"] = [*matches["rooms"], ["gone", "c1", 0.9]]
    assert "9\nrooms of the plan matched" in Page(report_html(dataclasses.replace(data, matches=matches))).text
