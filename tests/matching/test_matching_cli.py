"""`python -m matching.match` as a user runs it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from commands import called, refused
from plans import a_graph, flat, merged

from data import Floor, SceneGraph
from data.synthetic_maps.noise_models import draw

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
MAP = draw(PLAN, "real", np.random.default_rng(1), 5).s_graph


@pytest.fixture(scope="module")
def graphs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("graphs")
    PLAN.save(folder / "a.json")
    MAP.save(folder / "s.json")
    return folder


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--method", "magic"), "no matching method 'magic'"),
        (("--s-graph", "nowhere.json"), "nowhere.json"),
        (("--out", "nowhere/matches.json"), "no such folder"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(graphs: Path, change: tuple[str, str], message: str) -> None:
    given = {"--s-graph": graphs / "s.json", "--a-graph": graphs / "a.json", "--out": graphs / "x.json"}
    given[change[0]] = change[1]  # type: ignore[assignment]
    assert message in refused("matching.match", *(part for pair in given.items() for part in pair))


def in_floor(graph: SceneGraph, name: str) -> SceneGraph:
    """The graph with all that it has on one floor, ids made its own."""
    rooms = tuple(dataclasses.replace(r, id=f"{name}/{r.id}", floor=name) for r in graph.rooms)
    walls = tuple(
        dataclasses.replace(w, id=f"{name}/{w.id}", room=w.room and f"{name}/{w.room}", floor=name)
        for w in graph.wall_surfaces
    )
    return SceneGraph("map", rooms, walls, (), (Floor(name, f"storey {name}"),))


def test_a_storey_of_a_map_of_several_is_matched_with_a_storey_of_the_plan(graphs: Path) -> None:
    upper = a_graph(flat(np.random.default_rng(4)), "upper", "upper")
    merged(PLAN, upper).save(graphs / "storeys.json")
    other = draw(upper, "real", np.random.default_rng(1), 4).s_graph
    merged(in_floor(MAP, "first"), in_floor(other, "second")).save(graphs / "both.json")
    given = ["--s-graph", graphs / "both.json", "--a-graph", graphs / "storeys.json", "--out", graphs / "one.json"]
    given += ["--method", "voting"]
    assert "give --map-floor with one of: first (storey first), second" in refused("matching.match", *given)
    assert "has no storey 'attic'" in refused("matching.match", *given, "--map-floor", "first", "--floor", "attic")
    for own, there in (("storey first", "ground"), ("second", "upper")):
        done = called("matching.match", *given, "--map-floor", own, "--floor", there)
        answer = json.loads((graphs / "one.json").read_text())
        assert done.returncode == 0 and done.stdout.startswith("unique: ")
        assert (answer["status"], answer["floor"]) == ("unique", there)
