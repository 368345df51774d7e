"""`python -m matching.match` as a user runs it."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from plans import a_graph, flat, merged

from data import Floor, SceneGraph, UserError
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.train import main as train_command

pytestmark = pytest.mark.slow


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "matching.match", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def graphs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("graphs")
    plan = a_graph(flat(np.random.default_rng(3)), "ground")
    plan.save(folder / "a.json")
    draw(plan, "real", np.random.default_rng(1), 5).s_graph.save(folder / "s.json")
    return folder


def test_writes_the_answer(graphs):
    out = graphs / "matches.json"
    done = run("--s-graph", graphs / "s.json", "--a-graph", graphs / "a.json", "--out", out)
    assert done.returncode == 0, done.stderr
    answer = json.loads(out.read_text())
    keys = "status reason rooms wall_surfaces T_a_s floor hypotheses seconds"
    assert list(answer) == keys.split()
    assert answer["status"] == "unique" and done.stdout.startswith("unique: ")
    assert answer["floor"] == "ground"
    assert all(len(pair) == 3 for pair in answer["rooms"] + answer["wall_surfaces"])
    assert list(answer["hypotheses"][0]) == ["score", "T_a_s", "floor", "rooms"]
    assert answer["hypotheses"][0]["T_a_s"] == answer["T_a_s"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--method", "magic"), "no matching method 'magic'"),
        (("--s-graph", "nowhere.json"), "nowhere.json"),
        (("--out", "nowhere/matches.json"), "no such folder"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(graphs, change, message):
    given = {"--s-graph": graphs / "s.json", "--a-graph": graphs / "a.json", "--out": graphs / "x.json"}
    given[change[0]] = change[1]
    assert message in refused("matching.match", *(part for pair in given.items() for part in pair))


@pytest.mark.long
def test_a_storey_of_a_map_of_several_is_matched_with_a_storey_of_the_plan(graphs):
    plan, part = (SceneGraph.load(graphs / name) for name in ("a.json", "s.json"))
    upper = a_graph(flat(np.random.default_rng(4)), "upper", "upper")
    merged(plan, upper).save(graphs / "storeys.json")
    other = draw(upper, "real", np.random.default_rng(1), 4).s_graph
    merged(in_floor(part, "first"), in_floor(other, "second")).save(graphs / "both.json")
    given = ["--s-graph", graphs / "both.json", "--a-graph", graphs / "storeys.json", "--out", graphs / "one.json"]
    listed = "first (storey first), second (storey second)"
    assert f"has several storeys; give --map-floor with one of: {listed}" in refused("matching.match", *given)
    assert "has no storey 'attic'" in refused("matching.match", *given, "--map-floor", "first", "--floor", "attic")
    for own, there in (("storey first", "ground"), ("second", "upper")):
        done = run(*given, "--map-floor", own, "--floor", there)
        assert done.returncode == 0, done.stderr
        answer = json.loads((graphs / "one.json").read_text())
        assert (answer["status"], answer["floor"]) == ("unique", there)


def in_floor(graph, name):
    """The graph with all that it has on one floor, ids made its own."""
    rooms = tuple(dataclasses.replace(r, id=f"{name}/{r.id}", floor=name) for r in graph.rooms)
    walls = tuple(
        dataclasses.replace(w, id=f"{name}/{w.id}", room=w.room and f"{name}/{w.room}", floor=name)
        for w in graph.wall_surfaces
    )
    return SceneGraph("map", rooms, walls, (), (Floor(name, f"storey {name}"),))


def test_help_is_quick():
    """Because it loads nothing that takes seconds."""
    command = [sys.executable, "-X", "importtime", "-m", "matching.match", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "--s-graph" in done.stdout
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines()}
    assert "argparse" in loaded and not loaded & {"torch", "gtsam", "open3d", "ifcopenshell"}


@pytest.mark.parametrize("needing", ["paper@repository", "pca-gm", "train"])
def test_what_needs_pytorch_names_the_extra_and_the_rest_works_without(
    needing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(UserError, match=r"needs PyTorch; pip install 'sgslam\[torch\]'"):
        train_command(["--out", str(tmp_path)]) if needing == "train" else Matcher.load(needing)
    for method in ("learned", "voting", "combinatorial"):
        Matcher.load(method)
