"""Inspection of a plan before any robot drives: its defects, its self-similarity, rooms that must be seen."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from broken_ifc import BROKEN, write_broken
from commands import called
from methods import as_map, matcher
from odd_plans import odd_plans
from plans import a_graph, box, merged, moved, offices
from small_ifc import write_small_ifc

from data import Door, Floor, Room, SceneGraph
from data.generation.demo_building import write_demo_building
from data.ifc.deviations import ElementFinding, write_as_built
from data.plans import load_bim
from data.plans.elements import other_bodies, planned_elements
from data.synthetic_maps.exploration import Walk, storeys_of
from data.synthetic_maps.noise_models import draw_walk
from data.synthetic_maps.walks import nearest_first, restricted_to
from matching import Matcher
from matching.ambiguity import MatchCache, SelfSimilarity, Trials, plan_issues
from matching.ambiguity.rooms_to_localise import best_split
from sgslam.inspection import Inspection, InspectionSettings, inspect
from sgslam.inspection.page import inspection_html

VOTING = InspectionSettings("voting", max_maps=1)
WING = [box(0, 0, 5, 3), box(5.1, 0, 3, 5), box(0, 3.1, 2, 4)]


def with_doors(graph: SceneGraph, *doors: tuple[str, str, float, float]) -> SceneGraph:
    """Doors between two rooms each, at x, y."""
    return replace(graph, doors=tuple(Door(f"door{n}", (a, b), (x, y)) for n, (a, b, x, y) in enumerate(doors)))


def corridor_house() -> SceneGraph:
    """Uneven offices on both sides of a corridor, a door from each."""
    graph = a_graph(offices([3.0, 4.2, 5.1], [6.0, 2.6, 3.9]), "ground")
    doors = [(r.id, "room6", r.centroid[0], 5.06 if r.centroid[1] < 5 else 7.18) for r in graph.rooms[:-1]]
    return replace(with_doors(graph, *doors), floors=(Floor("ground", "Ground", 0.0),))


def test_the_nearest_room_by_the_way_through_doors_comes_first_and_across_walls_where_none_leads_on() -> None:
    storey = storeys_of(corridor_house())[0]
    walked, by_doors = nearest_first(storey, 0)
    names = [storey.rooms[k].id for k in walked.rooms]
    # from the first office below: the corridor, then by the places of the doors along it
    doors = {r.id: np.array([r.centroid[0], 5.06 if r.centroid[1] < 5 else 7.18]) for r in storey.rooms[:-1]}
    expected = sorted((n for n in doors if n != "room0"), key=lambda n: float(np.hypot(*(doors[n] - doors["room0"]))))
    assert names == ["room0", "room6", *expected] and by_doors == 7
    assert walked.parents[:2] == (-1, 0) and set(walked.parents[2:]) == {1}
    graph = with_doors(a_graph([box(0, 0, 4, 3), box(4.1, 0, 3, 3), box(7.2, 0, 5, 3)]), ("room0", "room1", 4.05, 1.5))
    walked, by_doors = nearest_first(storeys_of(graph)[0], 0)
    assert walked.rooms == (0, 1, 2) and walked.parents == (-1, 0, 1) and by_doors == 2


def test_a_map_grows_without_being_drawn_anew() -> None:
    storey = storeys_of(corridor_house())[0]
    walked, _ = nearest_first(storey, 0)
    drawn = draw_walk(storey, walked, "real", np.random.default_rng(5))
    order, before = [storey.rooms[k].id for k in walked.rooms], set()
    for n in range(1, len(order) + 1):
        part = restricted_to(drawn, set(order[:n]))
        walls = set(part.s_graph.wall_surfaces)
        assert before <= walls <= set(drawn.s_graph.wall_surfaces) and walls
        assert {part.rooms[w.room] for w in walls if w.room} <= set(order[:n])
        before = walls
    assert before == set(drawn.s_graph.wall_surfaces)


def test_each_issue_of_a_plan_is_reported() -> None:
    sound = corridor_house()
    assert plan_issues(sound) == []
    walls, floors, first = sound.wall_surfaces, sound.floors, sound.surfaces_of_room["room0"]
    roomless = replace(sound, wall_surfaces=tuple(replace(w, room=None) if w in first else w for w in walls))
    other = replace(a_graph([box(0, 0, 4, 4)], "upper", "up"), floors=(Floor("upper", "Upper", 0.4),))
    long, unmeasured, nowhere = (
        tuple(replace(w, **{name: value(w)}) for w in walls)
        for name, value in (
            ("length", lambda w: 1000.0 * w.length),
            ("length", lambda w: None),
            ("room", lambda w: None),
        )
    )
    pairs = [("room0", "room1", 4.05, 1.5), ("room2", "room3", 12.25, 1.5)]
    row = a_graph([box(0, 0, 4, 3), box(4.1, 0, 3, 3), box(7.2, 0, 5, 3), box(12.3, 0, 2, 3)])
    cases = {
        "walls without a room": roomless,
        "rooms without walls": roomless,
        "no doors": replace(sound, doors=()),
        "rooms without doors": replace(sound, doors=sound.doors[1:]),
        "doors without a room": replace(sound, doors=(*sound.doors, Door("lost", (), (50, 50)))),
        "storeys without an elevation": replace(sound, floors=(Floor("ground"),)),
        "empty storey": replace(sound, floors=(*floors, Floor("roof", "Roof", 3.0))),
        "implausible elevations": merged(sound, other),
        "implausible units": replace(sound, wall_surfaces=long),
        "overlapping rooms": merged(sound, a_graph([box(0, 0, 3, 4)], "ground", "twice")),
        "rooms without a footprint": replace(sound, rooms=tuple(replace(r, polygon=None) for r in sound.rooms)),
        "no rooms": replace(sound, rooms=(), doors=(), wall_surfaces=nowhere),
        "walls without a length": replace(sound, wall_surfaces=unmeasured),
        "unconnected groups of rooms": with_doors(row, *pairs),
    }
    found = {kind: {issue.kind: issue for issue in plan_issues(graph)} for kind, graph in cases.items()}
    assert [kind for kind in cases if kind not in found[kind]] == []
    overlap, groups = (found[kind][kind] for kind in ("overlapping rooms", "unconnected groups of rooms"))
    assert overlap.ids == ("room0", "twiceroom0") and "12.0 m2" in overlap.message
    assert groups.message.startswith("2 groups of 2, 2 rooms") and groups.ids == ("room0", "room2")


def test_walls_that_bound_no_room_are_counted_once_and_not_where_they_are_the_back_of_one_that_does() -> None:
    sound = corridor_house()
    (wall,) = (w for w in sound.surfaces_of_room["room0"] if w.normal[0] > 0.9)
    (x, y), (nx, ny) = wall.centroid, wall.normal
    back = replace(wall, id="back", room=None, centroid=(x - 0.3 * nx, y - 0.3 * ny), normal=(-nx, -ny))
    assert plan_issues(replace(sound, wall_surfaces=(*sound.wall_surfaces, back))) == []
    faces = [replace(w, room=None, centroid=(90.0, 0.1 * k), source="fence") for k, w in enumerate((wall, back))]
    both = [replace(own, id=f"fence {k}") for k, own in enumerate(faces)]
    (issue,) = plan_issues(replace(sound, wall_surfaces=(*sound.wall_surfaces, *both)))
    assert issue.message.endswith(": 1") and issue.ids == ("fence 0", "fence 1")


@pytest.mark.parametrize("kind", odd_plans())
def test_a_storey_may_lack_rooms_or_walls(kind: str, tmp_path: Path) -> None:
    """Foundations, roofs, and plans that were drawn by halves; the same plan above matches a map as ever."""
    plan, path = odd_plans()[kind], tmp_path / "plan.json"
    plan.save(path)
    words = ("--method", "voting", "--maps", 1, "--jobs", 1, "--out", tmp_path / "out")
    done = called("sgslam.cli.inspect_bim", path, *words)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out/inspection.json").read_text())
    assert {room["room"] for room in told["rooms"]} == {r.id for s in storeys_of(plan) for r in s.rooms}
    seen = as_map(odd_plans()["one room in all"])
    for method in ("voting", "learned"):
        for floor in (None, "cellar"):
            assert matcher(method).match(seen, plan, floor=floor).status in ("none", "ambiguous")


@pytest.mark.slow
@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_model_is_read_or_refused(kind: str, tmp_path: Path) -> None:
    """And what can be read can be inspected, compared with a building, and written with its verdicts."""
    ifc = write_broken(write_small_ifc(tmp_path / "small.ifc").path, kind, tmp_path / "broken.ifc")
    done = called("sgslam.cli.inspect_bim", ifc, "--method", "voting", "--maps", 1, "--jobs", 1, "--out", tmp_path)
    if done.returncode == 2:
        assert "fillings" not in kind, "a door or window that refers to what is missing costs no more than itself"
        assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1, done.stderr
        return
    assert done.returncode == 0, done.stderr
    finding = ElementFinding(load_bim(ifc).graph.wall_surfaces[0].source, "moved", (0.1, 0.0, 0.0), 0.01, 0.0, "")
    assert planned_elements(ifc) and np.isfinite(other_bodies(ifc)).all()
    assert write_as_built(ifc, [finding], [], tmp_path / "as_built.ifc") == 1


def test_a_room_that_resembles_another_names_it() -> None:
    plan = a_graph([box(0, 0, 5, 3), box(20, 0, 5, 3), box(40, 0, 8, 7)])
    found = SelfSimilarity(plan).similar_places(["room0"])
    assert {place.counterparts[0] for place in found} == {"room0", "room1"}  # itself, by half a turn, and the other one
    assert SelfSimilarity(plan).similar_places(["room0", "room1", "room2"]) == []


def two_storeys() -> SceneGraph:
    """The house with a corridor, and two rooms above."""
    both = merged(corridor_house(), a_graph([box(0, 0, 7.3, 4.4), box(7.4, 0, 2.2, 5.7)], "upper", "up"))
    return replace(both, floors=(Floor("ground", "Ground", 0.0), Floor("upper", "Upper", 3.0)))


@pytest.fixture(scope="module")
def house() -> Inspection:
    return inspect(two_storeys(), settings=VOTING)


def test_uneven_rooms_are_localised_after_a_few(house: Inspection) -> None:
    found = [r.to_localise for r in house.rooms.values() if r.to_localise.floor == "ground"]
    assert len(found) == 7 and len(house.rooms) == 9 and all(n.outcome == "known" for n in found)
    needed = [(n.rooms_if_perfect, n.rooms) for n in found]
    assert all(perfect is not None and rooms is not None and perfect <= rooms <= 5 for perfect, rooms in needed)


def test_trials_depend_on_the_rooms_alone_and_stop_once_the_majority_is_clear() -> None:
    storey, voting = storeys_of(corridor_house())[0], Matcher.load("voting")

    def cache(seed: int) -> MatchCache:
        return MatchCache(corridor_house(), storey, 0, voting, seed, max_maps=7)

    few, more = frozenset({0, 6}), frozenset({0, 1, 6})
    once, again = cache(0), cache(0)
    assert (once.trials(few), once.trials(more)) == (again.trials(more), again.trials(few))[::-1]
    assert any(cache(seed).trials(few) != once.trials(few) for seed in range(1, 6))
    assert Trials(4, 4).decided(21) and Trials(0, 5).decided(21) and Trials(10, 16).decided(21)
    assert not Trials(0, 4).decided(21) and not Trials(3, 3).decided(21) and not Trials(2, 3).decided(4)
    assert Trials(0, 3).decided(5) and Trials(2, 4).decided(4) and Trials(4, 4).clearly_localised
    assert not Trials(10, 16).clearly_localised and not Trials(3, 3).clearly_localised


def test_the_reported_number_splits_the_trials_best() -> None:
    none, few, half, all_ = Trials(0, 5), Trials(3, 11), Trials(5, 10), Trials(3, 3)
    assert best_split({2: none, 3: few, 4: all_}) == 4 and best_split({2: half, 3: all_}) == 2
    assert best_split({2: Trials(7, 10), 3: half, 4: Trials(4, 11), 5: all_}) == 2
    assert best_split({2: Trials(6, 10), 3: none, 4: all_}) == 4
    assert best_split({2: none, 3: few}) is None and best_split({}) is None


def test_equal_houses_and_storeys_are_never_told_apart() -> None:
    left = a_graph(WING, "ground", "left")
    both = merged(left, moved(a_graph(WING, "ground", "right"), np.pi, 30, 0))
    for plan, outcome in ((both, "never"), (left, "known")):
        assert {r.to_localise.outcome for r in inspect(plan, settings=VOTING).rooms.values()} == {outcome}
    stacked = merged(a_graph(WING, "one", "a"), a_graph(WING, "two", "b"))
    floors = (Floor("one", "One", 0.0), Floor("two", "Two", 3.0))
    found = inspect(replace(stacked, floors=floors), settings=VOTING)
    assert {t.floor for t in found.similar_storeys} == {"one", "two"}
    assert all(t.nats < 1e-6 and None not in t.counterparts for t in found.similar_storeys)
    assert "Two, rotated by 0°" in inspection_html(found, "similar")


def test_a_room_without_walls_gets_no_number_and_names_are_text() -> None:
    sound = corridor_house()
    bare = replace(sound, rooms=(*sound.rooms, Room("shaft", (50.0, 50.0), "ground", "<b>Shaft</b>")))
    found = inspect(bare, settings=VOTING)
    assert found.rooms["shaft"].to_localise.outcome == "no walls" and found.rooms["shaft"].similar_places == ()
    page = inspection_html(found, "<i>house</i>")
    assert "<b>Shaft" not in page and "&lt;b&gt;Shaft" in page and "<i>house" not in page


@pytest.mark.long
def test_the_command_writes_page_and_values(tmp_path: Path, house: Inspection) -> None:
    """The same however many processes there are."""
    two_storeys().save(tmp_path / "house.json")
    words = ["--out", str(tmp_path / "out"), "--method", "voting", "--maps", "1", "--jobs", "2"]
    command = [sys.executable, "-m", "sgslam", "inspect-bim", str(tmp_path / "house.json"), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    values = json.loads((tmp_path / "out/inspection.json").read_text())
    same = json.loads(json.dumps(house.to_dict()))
    assert values == {"file": "house.json", "method": "voting", "maps": 1, "seed": 0, **same}
    page = (tmp_path / "out/inspection.html").read_text()
    assert {"Ground", "Upper"} <= set(re.findall(r"\w+", page))


@pytest.mark.long
def test_maps_of_as_many_rooms_as_are_predicted_are_localised_and_smaller_ones_not(tmp_path: Path) -> None:
    """Maps of the demo's rooms, drawn anew, in the order in which a robot enters them from each start room."""
    write_demo_building(tmp_path / "demo.ifc")
    graph = load_bim(tmp_path / "demo.ifc").graph
    found, learned = inspect(graph, settings=InspectionSettings(max_maps=5)).rooms, Matcher.load()
    agrees: dict[bool, list[bool]] = {True: [], False: []}
    for place, storey in enumerate(storeys_of(graph)):
        for start, room in list(enumerate(storey.rooms))[::4]:
            needed = found[room.id].to_localise.rooms
            way = nearest_first(storey, start)[0]
            for rooms in (needed, needed - 1) if needed else (len(way.rooms),):
                known = 0
                for k in range(5 if rooms else 0):
                    rng = np.random.default_rng((1, place, start, rooms, k))
                    drawn = draw_walk(storey, Walk(way.rooms[:rooms], way.parents[:rooms]), "real", rng)
                    answer = learned.match(drawn.s_graph, graph)
                    right = all(drawn.rooms[s_id] == a_id for s_id, a_id, _ in answer.rooms)
                    known += answer.status == "unique" and right
                enough = needed is not None and rooms >= needed
                if rooms:
                    agrees[enough].append((known > 2) == enough)
    assert len(agrees[True]) >= 3 and len(agrees[False]) >= 2
    assert all(np.mean(own) > 0.5 for own in agrees.values()), agrees
