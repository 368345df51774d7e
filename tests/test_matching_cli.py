"""`python -m matching.match` as a user runs it."""

import json
import subprocess
import sys

import numpy as np
import pytest
from commands import refused
from plans import a_graph, flat
from s_graph_noise import draw


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "matching.match", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def graphs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("graphs")
    plan = a_graph(flat(np.random.default_rng(3)), "ground")
    plan.save(folder / "a.json")
    draw(plan, np.random.default_rng(1), 5).s.save(folder / "s.json")
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
    ("change", "told"),
    [
        (("--method", "magic"), "no matching method 'magic'"),
        (("--s-graph", "nowhere.json"), "nowhere.json"),
        (("--out", "nowhere/matches.json"), "no such folder"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(graphs, change, told):
    given = {"--s-graph": graphs / "s.json", "--a-graph": graphs / "a.json", "--out": graphs / "x.json"}
    given[change[0]] = change[1]
    assert told in refused("matching.match", *(part for pair in given.items() for part in pair))


def test_help_is_quick():
    """Because it loads nothing that takes seconds."""
    command = [sys.executable, "-X", "importtime", "-m", "matching.match", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "--s-graph" in done.stdout
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines()}
    assert "argparse" in loaded and not loaded & {"torch", "gtsam", "open3d", "ifcopenshell"}
