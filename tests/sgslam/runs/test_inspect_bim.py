"""Inspection of a plan before any robot drives: its defects, its self-similarity, rooms that must be seen."""

import json
import re
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from broken_ifc import BROKEN, write_broken
from commands import called
from methods import as_map, matcher
from odd_plans import odd_plans
from plans import a_graph, box, merged, moved, offices
from report_samples import verdict
from small_ifc import write_small_ifc

from data import Door, Floor, Room, SceneGraph
from data.generation import write_demo_building
from data.ifc.deviations import write_as_built
from data.plans import load_bim
from data.plans.elements import other_bodies, planned_elements
from data.synthetic_maps.exploration import Walk, nearest_first, storeys_of
from data.synthetic_maps.noise_models import draw_walk
from matching import Matcher
from matching.ambiguity.plan_checks import plan_issues
from matching.ambiguity.rooms_to_localise import MatchCache, Trials, best_split
from sgslam.inspection import Inspection, inspect
from sgslam.inspection.page import inspection_html

by_votes = partial(inspect, method="voting", maps=1)
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
    graph = with_doors(a_graph([box(0, 0, 4, 3), box(4.1, 0, 3, 3), box(7.2, 0, 5, 3)]), ("room0", "room1", 4.05, 1.5))
    walked, by_doors = nearest_first(storeys_of(graph)[0], 0)
    assert walked.rooms == (0, 1, 2) and walked.parents == (-1, 0, 1) and by_doors == 2
    walked, by_doors = nearest_first(storeys_of(corridor_house())[0], 0)
    assert walked.rooms[1] == 6 and set(walked.parents[2:]) == {1} and by_doors == 7  # by the corridor


def test_each_issue_of_a_plan_is_reported() -> None:
    sound = corridor_house()
    assert plan_issues(sound) == []
    walls, floors, first = sound.wall_surfaces, sound.floors, sound.surfaces_of_room["room0"]
    roomless = replace(sound, wall_surfaces=tuple(replace(w, room=None) if w in first else w for w in walls))
    other = replace(a_graph([box(0, 0, 4, 4)], "upper", "up"), floors=(Floor("upper", "Upper", 0.4),))
    long = tuple(replace(w, length=1000.0 * (w.length or 0.0)) for w in walls)
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
        "no rooms": replace(sound, rooms=(), doors=(), wall_surfaces=tuple(replace(w, room=None) for w in walls)),
        "walls without a length": replace(sound, wall_surfaces=tuple(replace(w, length=None) for w in walls)),
        "unconnected groups of rooms": with_doors(row, ("room0", "room1", 4.05, 1.5), ("room2", "room3", 12.25, 1.5)),
    }
    found = {kind: {issue.kind: issue for issue in plan_issues(graph)} for kind, graph in cases.items()}
    assert [kind for kind in cases if kind not in found[kind]] == []
    overlap = found["overlapping rooms"]["overlapping rooms"]
    assert overlap.ids == ("room0", "twiceroom0") and "12.0 m2" in overlap.message


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
        assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1, done.stderr
        return
    assert done.returncode == 0, done.stderr
    finding = asdict(verdict(load_bim(ifc).graph.wall_surfaces[0].source, "moved", 0.1))
    assert planned_elements(ifc) and np.isfinite(other_bodies(ifc)).all()
    assert write_as_built(ifc, [finding], [], tmp_path / "as_built.ifc") == 1


@pytest.fixture(scope="module")
def house() -> Inspection:
    """Two storeys, and a shaft without walls."""
    both = merged(corridor_house(), a_graph([box(0, 0, 7.3, 4.4), box(7.4, 0, 2.2, 5.7)], "upper", "up"))
    rooms = (*both.rooms, Room("shaft", (50.0, 50.0), "ground", "<b>Shaft</b>"))
    floors = (Floor("ground", "Ground", 0.0), Floor("upper", "Upper", 3.0))
    return by_votes(replace(both, rooms=rooms, floors=floors))


def test_trials_depend_on_the_rooms_alone_and_stop_once_the_majority_is_clear() -> None:
    storey, voting = storeys_of(corridor_house())[0], Matcher.load("voting")
    few, more = frozenset({0, 6}), frozenset({0, 1, 6})
    once, again = (MatchCache(corridor_house(), storey, 0, voting, 0, max_maps=7) for _ in range(2))
    assert (once.trials(few), once.trials(more)) == (again.trials(more), again.trials(few))[::-1]
    assert Trials(4, 4).decided(21) and Trials(0, 5).decided(21) and Trials(10, 16).decided(21)
    assert not Trials(0, 4).decided(21) and not Trials(3, 3).decided(21) and not Trials(2, 3).decided(4)
    assert Trials(4, 4).clearly_localised and not Trials(10, 16).clearly_localised


def test_the_reported_number_splits_the_trials_best() -> None:
    none, few, half, all_ = Trials(0, 5), Trials(3, 11), Trials(5, 10), Trials(3, 3)
    assert best_split({2: none, 3: few, 4: all_}) == 4 and best_split({2: half, 3: all_}) == 2
    assert best_split({2: none, 3: few}) is None and best_split({}) is None


def test_equal_houses_and_storeys_are_never_told_apart() -> None:
    left = a_graph(WING, "ground", "left")
    both = merged(left, moved(a_graph(WING, "ground", "right"), np.pi, 30, 0))
    for plan, outcome in ((both, "never"), (left, "known")):
        assert {r.to_localise.outcome for r in by_votes(plan).rooms.values()} == {outcome}
    stacked = merged(a_graph(WING, "one", "a"), a_graph(WING, "two", "b"))
    floors = (Floor("one", "One", 0.0), Floor("two", "Two", 3.0))
    found = by_votes(replace(stacked, floors=floors))
    assert {t.floor for t in found.similar_storeys} == {"one", "two"}
    assert all(t.nats < 1e-6 and None not in t.counterparts for t in found.similar_storeys)
    assert "Two, rotated by 0°" in inspection_html(found, "similar")


def test_uneven_rooms_are_localised_after_a_few_and_the_page_takes_names_as_text(house: Inspection) -> None:
    found = [r.to_localise for r in house.rooms.values() if r.to_localise.floor == "ground"]
    shaft = found.pop()
    assert len(found) == 7 and len(house.rooms) == 10 and all(n.outcome == "known" for n in found)
    needed = [(n.rooms_if_perfect, n.rooms) for n in found]
    assert all(perfect is not None and rooms is not None and perfect <= rooms <= 5 for perfect, rooms in needed)
    assert shaft.outcome == "no walls" and house.rooms["shaft"].similar_places == ()
    page = inspection_html(house, "<i>house</i>")
    assert "<b>Shaft" not in page and "&lt;b&gt;Shaft" in page and "<i>house" not in page
    assert {"Ground", "Upper"} <= set(re.findall(r"\w+", page))


@pytest.mark.long
def test_maps_of_as_many_rooms_as_are_predicted_are_localised_and_smaller_ones_not(tmp_path: Path) -> None:
    """Maps of the demo's rooms, drawn anew, in the order in which a robot enters them from each start room."""
    write_demo_building(tmp_path / "demo.ifc")
    graph = load_bim(tmp_path / "demo.ifc").graph
    found, learned = inspect(graph, maps=5).rooms, Matcher.load()
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
