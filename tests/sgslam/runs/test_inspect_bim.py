"""Inspection of a plan before any robot drives: its defects, its self-similarity, rooms that must be seen."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from broken_ifc import BROKEN, write_broken
from commands import called, refused
from methods import as_map, matcher
from odd_plans import odd_plans
from plans import a_graph, box, merged, moved, offices
from small_ifc import write_small_ifc

from data import Door, Floor, Room, SceneGraph
from data.ifc.deviations import ElementFinding, write_as_built
from data.plans import load_bim
from data.plans.elements import other_bodies, planned_elements
from data.synthetic_maps.exploration import storeys_of
from data.synthetic_maps.noise_models import draw_walk
from data.synthetic_maps.walks import nearest_first, restricted_to
from evaluation.studies.rooms_to_localise import STUDY, BuildingCase, Side, Start, Starts, sides_of
from evaluation.studies.rooms_to_localise import Choice as CheckOptions
from matching import Matcher
from matching.ambiguity import MatchCache, SelfSimilarity, Trials, plan_issues
from matching.ambiguity.rooms_to_localise import best_split
from sgslam.inspection import Inspection, InspectionSettings, inspect
from sgslam.inspection.page import inspection_html

VOTING = InspectionSettings("voting", max_maps=1)


def with_doors(graph: SceneGraph, *doors: tuple[str, str, float, float]) -> SceneGraph:
    """Doors between two rooms each, at x, y."""
    made = tuple(Door(f"door{n}", (a, b), (x, y)) for n, (a, b, x, y) in enumerate(doors))
    return dataclasses.replace(graph, doors=made)


def corridor_house() -> SceneGraph:
    """Uneven offices on both sides of a corridor, a door from each."""
    graph = a_graph(offices([3.0, 4.2, 5.1], [6.0, 2.6, 3.9]), "ground")
    doors = [(r.id, "room6", r.centroid[0], 5.06 if r.centroid[1] < 5 else 7.18) for r in graph.rooms[:-1]]
    return dataclasses.replace(with_doors(graph, *doors), floors=(Floor("ground", "Ground", 0.0),))


def test_the_nearest_room_by_the_way_through_doors_comes_first() -> None:
    storey = storeys_of(corridor_house())[0]
    walked, by_doors = nearest_first(storey, 0)
    names = [storey.rooms[k].id for k in walked.rooms]
    # from the first office below: the corridor, then by the places of the doors along it
    doors = {r.id: np.array([r.centroid[0], 5.06 if r.centroid[1] < 5 else 7.18]) for r in storey.rooms[:-1]}
    expected = sorted((n for n in doors if n != "room0"), key=lambda n: float(np.hypot(*(doors[n] - doors["room0"]))))
    assert names == ["room0", "room6", *expected] and by_doors == len(names) == 7
    assert walked.parents[:2] == (-1, 0) and set(walked.parents[2:]) == {1}


def test_where_no_door_leads_on_the_way_is_across_walls() -> None:
    graph = with_doors(a_graph([box(0, 0, 4, 3), box(4.1, 0, 3, 3), box(7.2, 0, 5, 3)]), ("room0", "room1", 4.05, 1.5))
    walked, by_doors = nearest_first(storeys_of(graph)[0], 0)
    assert walked.rooms == (0, 1, 2) and walked.parents == (-1, 0, 1) and by_doors == 2


def test_a_map_grows_without_being_drawn_anew() -> None:
    storey = storeys_of(corridor_house())[0]
    walked, _ = nearest_first(storey, 0)
    drawn = draw_walk(storey, walked, "real", np.random.default_rng(5))
    order = [storey.rooms[k].id for k in walked.rooms]
    sizes, before = [], set()
    for n in range(1, len(order) + 1):
        part = restricted_to(drawn, set(order[:n]))
        walls = set(part.s_graph.wall_surfaces)
        assert before <= walls <= set(drawn.s_graph.wall_surfaces)
        assert {part.rooms[w.room] for w in walls if w.room} <= set(order[:n])
        before = walls
        sizes.append(len(walls))
    assert sizes[-1] == len(drawn.s_graph.wall_surfaces) > sizes[0] > 0


def kinds(graph: SceneGraph) -> set[str]:
    return {issue.kind for issue in plan_issues(graph)}


def test_a_sound_plan_has_no_issues() -> None:
    assert kinds(corridor_house()) == set()


def test_each_issue_of_a_plan_is_reported() -> None:
    sound = corridor_house()
    first = sound.surfaces_of_room["room0"]
    roomless = tuple(dataclasses.replace(w, room=None) if w in first else w for w in sound.wall_surfaces)
    nowhere = tuple(dataclasses.replace(w, room=None) for w in sound.wall_surfaces)
    long = tuple(dataclasses.replace(w, length=1000.0 * (w.length or 1)) for w in sound.wall_surfaces)
    other = moved(a_graph([box(0, 0, 4, 4)], "upper", "up"), 0, 0, 0)
    cases = {
        "walls without a room": dataclasses.replace(sound, wall_surfaces=roomless),
        "rooms without walls": dataclasses.replace(sound, wall_surfaces=roomless),
        "no doors": dataclasses.replace(sound, doors=()),
        "rooms without doors": dataclasses.replace(sound, doors=sound.doors[1:]),
        "doors without a room": dataclasses.replace(sound, doors=(*sound.doors, Door("lost", (), (50, 50)))),
        "storeys without an elevation": dataclasses.replace(sound, floors=(Floor("ground"),)),
        "empty storey": dataclasses.replace(sound, floors=(*sound.floors, Floor("roof", "Roof", 3.0))),
        "implausible elevations": merged(sound, dataclasses.replace(other, floors=(Floor("upper", "Upper", 0.4),))),
        "implausible units": dataclasses.replace(sound, wall_surfaces=long),
        "overlapping rooms": merged(sound, a_graph([box(0, 0, 3, 4)], "ground", "twice")),
        "rooms without a footprint": dataclasses.replace(
            sound, rooms=tuple(dataclasses.replace(r, polygon=None) for r in sound.rooms)
        ),
        "no rooms": dataclasses.replace(sound, rooms=(), doors=(), wall_surfaces=nowhere),
        "walls without a length": dataclasses.replace(
            sound, wall_surfaces=tuple(dataclasses.replace(w, length=None) for w in sound.wall_surfaces)
        ),
    }  # fmt: skip
    for kind, graph in cases.items():
        assert kind in kinds(graph), kind
    (overlap,) = (g for g in plan_issues(cases["overlapping rooms"]) if g.kind == "overlapping rooms")
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
        assert "fillings" not in kind, "a door or window that refers to what is missing costs no more than itself"
        assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1, done.stderr
        return
    assert done.returncode == 0, done.stderr
    walls = load_bim(ifc).graph.wall_surfaces
    finding = ElementFinding(walls[0].source, "moved", (0.1, 0.0, 0.0), 0.01, 0.0, "")
    assert planned_elements(ifc) and np.isfinite(other_bodies(ifc)).all()
    assert write_as_built(ifc, [finding], [], tmp_path / "as_built.ifc") == 1


def test_walls_that_bound_no_room_are_counted() -> None:
    sound = corridor_house()
    (wall,) = (w for w in sound.surfaces_of_room["room0"] if w.normal[0] > 0.9)
    (x, y), (nx, ny) = wall.centroid, wall.normal
    back = dataclasses.replace(wall, id="back", room=None, centroid=(x - 0.3 * nx, y - 0.3 * ny), normal=(-nx, -ny))
    assert kinds(dataclasses.replace(sound, wall_surfaces=(*sound.wall_surfaces, back))) == set()
    both = [dataclasses.replace(w, id=f"{w.id} {k}", centroid=(90.0, 0.1 * k), source="fence")
            for k, w in enumerate((dataclasses.replace(wall, room=None), back))]  # fmt: skip
    (issue,) = plan_issues(dataclasses.replace(sound, wall_surfaces=(*sound.wall_surfaces, *both)))
    assert issue.message.endswith(": 1") and issue.ids == tuple(w.id for w in both)


def test_unconnected_groups_of_rooms_are_counted() -> None:
    boxes = [box(0, 0, 4, 3), box(4.1, 0, 3, 3), box(7.2, 0, 5, 3), box(12.3, 0, 2, 3)]
    graph = with_doors(a_graph(boxes), ("room0", "room1", 4.05, 1.5), ("room2", "room3", 12.25, 1.5))
    (issue,) = (g for g in plan_issues(graph) if g.kind == "unconnected groups of rooms")
    assert issue.message.startswith("2 groups of 2, 2 rooms") and issue.ids == ("room0", "room2")


def test_a_room_that_resembles_another_names_it() -> None:
    plan = a_graph([box(0, 0, 5, 3), box(20, 0, 5, 3), box(40, 0, 8, 7)])
    found = SelfSimilarity(plan).similar_places(["room0"])
    assert {place.counterparts[0] for place in found} == {"room0", "room1"}  # itself, by half a turn, and the other one
    assert SelfSimilarity(plan).similar_places(["room0", "room1", "room2"]) == []


def two_storeys() -> SceneGraph:
    """The house with a corridor, and two rooms above."""
    both = merged(corridor_house(), a_graph([box(0, 0, 7.3, 4.4), box(7.4, 0, 2.2, 5.7)], "upper", "up"))
    return dataclasses.replace(both, floors=(Floor("ground", "Ground", 0.0), Floor("upper", "Upper", 3.0)))


@pytest.fixture(scope="module")
def house() -> Inspection:
    return inspect(two_storeys(), settings=VOTING)


def test_uneven_rooms_are_localised_after_a_few(house: Inspection) -> None:
    found = [r.to_localise for r in house.rooms.values() if r.to_localise.floor == "ground"]
    assert len(found) == 7 and len(house.rooms) == 9 and all(n.outcome == "known" for n in found)
    needed = [(n.rooms_if_perfect, n.rooms) for n in found]
    assert all(perfect is not None and rooms is not None and perfect <= rooms <= 5 for perfect, rooms in needed)


def test_trials_depend_on_the_rooms_alone() -> None:
    storey, matcher = storeys_of(corridor_house())[0], Matcher.load("voting")

    def cache(seed: int) -> MatchCache:
        return MatchCache(corridor_house(), storey, 0, matcher, seed, max_maps=7)

    few, more = frozenset({0, 6}), frozenset({0, 1, 6})
    once, again = cache(0), cache(0)
    assert (once.trials(few), once.trials(more)) == (again.trials(more), again.trials(few))[::-1]
    assert any(cache(seed).trials(few) != once.trials(few) for seed in range(1, 6))


def test_trials_stop_once_the_majority_is_clear() -> None:
    assert Trials(4, 4).decided(21) and Trials(0, 5).decided(21) and Trials(10, 16).decided(21)
    assert not Trials(0, 4).decided(21) and not Trials(3, 3).decided(21) and not Trials(2, 3).decided(4)
    assert Trials(0, 3).decided(5) and Trials(2, 4).decided(4)
    assert Trials(4, 4).clearly_localised
    assert not Trials(10, 16).clearly_localised and not Trials(3, 3).clearly_localised


def test_the_reported_number_splits_the_trials_best() -> None:
    none, few, half, all_ = Trials(0, 5), Trials(3, 11), Trials(5, 10), Trials(3, 3)
    assert best_split({2: none, 3: few, 4: all_}) == 4 and best_split({2: half, 3: all_}) == 2
    assert best_split({2: Trials(7, 10), 3: half, 4: Trials(4, 11), 5: all_}) == 2
    assert best_split({2: Trials(6, 10), 3: none, 4: all_}) == 4
    assert best_split({2: none, 3: few}) is None and best_split({}) is None


def test_beside_an_identical_house_the_place_stays_ambiguous() -> None:
    wing = [box(0, 0, 5, 3), box(5.1, 0, 3, 5), box(0, 3.1, 2, 4)]
    left = a_graph(wing, "ground", "left")
    both = merged(left, moved(a_graph(wing, "ground", "right"), np.pi, 30, 0))
    found = inspect(both, settings=VOTING)
    assert {r.to_localise.outcome for r in found.rooms.values()} == {"never"}
    only = inspect(left, settings=VOTING)
    assert {r.to_localise.outcome for r in only.rooms.values()} == {"known"}


def test_equal_storeys_are_similar() -> None:
    rooms = [box(0, 0, 5, 3), box(5.1, 0, 3, 5), box(0, 3.1, 2, 4)]
    both = merged(a_graph(rooms, "one", "a"), a_graph(rooms, "two", "b"))
    floors = (Floor("one", "One", 0.0), Floor("two", "Two", 3.0))
    found = inspect(dataclasses.replace(both, floors=floors), settings=VOTING)
    assert {t.floor for t in found.similar_storeys} == {"one", "two"}
    assert all(t.nats < 1e-6 and None not in t.counterparts for t in found.similar_storeys)
    page = inspection_html(found, "similar")
    assert "Two, rotated by 0°" in page and "heat-never" in page


def test_a_room_without_walls_gets_no_number() -> None:
    sound = corridor_house()
    bare = dataclasses.replace(sound, rooms=(*sound.rooms, Room("shaft", (50.0, 50.0), "ground", "<b>Shaft</b>")))
    found = inspect(bare, settings=VOTING)
    assert found.rooms["shaft"].to_localise.outcome == "no walls" and found.rooms["shaft"].similar_places == ()
    page = inspection_html(found, "<i>house</i>")
    assert "<b>Shaft" not in page and "&lt;b&gt;Shaft" in page and "<i>house" not in page


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sgslam", "inspect-bim", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.long
@pytest.mark.slow
def test_the_command_writes_page_and_values(tmp_path: Path, house: Inspection) -> None:
    two_storeys().save(tmp_path / "house.json")
    done = run(tmp_path / "house.json", "--out", tmp_path / "out", "--method", "voting", "--maps", 1, "--jobs", 2)
    assert done.returncode == 0, done.stderr
    values = json.loads((tmp_path / "out/inspection.json").read_text())
    same = json.loads(json.dumps(house.to_dict()))  # however many processes there are
    assert values == {"file": "house.json", "method": "voting", "maps": 1, "seed": 0, **same}
    page = (tmp_path / "out/inspection.html").read_text()
    assert page.count('<svg class="storey"') == 2 and page.count("<polygon class=") == 9 + 2 * 10  # rooms, legends
    assert done.stdout.splitlines()[-1] == f"page: {tmp_path / 'out/inspection.html'}"


@pytest.mark.parametrize(("arguments", "told"), [(["nowhere.ifc"], "nowhere.ifc"), (["--maps", "0"], "--maps")])
def test_a_users_mistake_is_one_line(tmp_path: Path, arguments: list[str], told: str) -> None:
    corridor_house().save(tmp_path / "house.json")
    file = [] if arguments[0] == "nowhere.ifc" else [tmp_path / "house.json"]
    assert told in refused("sgslam.cli.inspect_bim", *file, *arguments, "--out", tmp_path / "out")


def test_the_check_asks_the_benchmark_on_both_sides_of_what_was_foretold() -> None:
    assert (
        sides_of(1) == [(1, True)] and sides_of(5) == [(4, False), (6, True)] and sides_of(6) == [(4, False), (6, True)]
    )
    assert sides_of(40) == [(14, False), (None, True)] and sides_of(None) == [(None, False)]


def test_the_check_agrees_where_most_maps_are_as_foretold() -> None:
    fewer, enough, never = ((4, False, 1), (6, True, 2), (None, False, 2))
    starts = Starts(starts=(start("r", 5, fewer, enough), start("q", None, never)))
    case = BuildingCase(building="house.ifc", order="near", every=1, pairs=3, maps=1, seed=0)
    table = STUDY.tables(pd.DataFrame([{**case.model_dump(), **starts.model_dump()}]))["buildings"]
    assert table.iloc[0].tolist() == ["house", 2, "100 % (1 of 1)", "50 % (1 of 2)", "50 % (1 of 2)"]


def start(room: str, needed: int | None, *sides: tuple[int | None, bool, int]) -> Start:
    """A start room of which so many of three maps are known on each side."""
    return Start(room=room, needed=needed, sides=[Side(rooms=n, predicted=p, known=k, of=3) for n, p, k in sides])


@pytest.mark.slow
def test_each_start_room_of_a_building_is_checked(tmp_path: Path) -> None:
    corridor_house().save(tmp_path / "house.json")
    options = CheckOptions(buildings=(str(tmp_path / "house.json"),), every=3, pairs=3, maps=1)
    (case,) = STUDY.cases(options)
    found = STUDY.measure(case, tmp_path)
    assert isinstance(found, Starts) and [s.room for s in found.starts] == ["room0", "room3", "room6"]
    assert all(side.known <= side.of and 2 <= side.of <= 3 for s in found.starts for side in s.sides)
