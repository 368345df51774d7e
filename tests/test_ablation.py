"""The ablation's list, its CSV and its table; one arm run on a user's own sequence."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_ifc import STOREY, write_small_ifc

from data.errors import UserError
from data.simulate import simulate
from evaluation.ablation import ablate, table
from evaluation.sequences import SequenceSpec, read_specs


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    """A short drive as a user's own scans and truth."""
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "small.ifc")
    simulate(building.path, STOREY, folder / "drive", seed=1, min_rooms=1, min_length=6.0)
    return SequenceSpec(
        "own", str(building.path), scans=str(folder / "drive" / "scans"), truth=str(folder / "drive" / "truth.tum")
    )


def test_arms_are_run_once_and_measured(own: SequenceSpec, tmp_path: Path) -> None:
    first = ablate([own], [0], ["graph"], tmp_path)
    before = (tmp_path / "runs.csv").read_bytes()
    assert ablate([own], [0], ["graph"], tmp_path) == first
    assert (tmp_path / "runs.csv").read_bytes() == before
    records = ablate([own], [0], ["graph", "oracle"], tmp_path)
    assert [r["arm"] for r in records] == ["graph", "oracle"] and records[0] == first[0]
    graph, oracle = records
    assert float(graph["rmse_bim_m"]) < 0.05 and graph["anchored"] == "False"
    assert oracle["anchored"] == "True" and float(oracle["rmse_bim_m"]) < 0.03
    expected = 1 - float(oracle["rmse_bim_m"]) / float(graph["rmse_bim_m"])
    assert np.isclose(float(oracle["drift_reduction"]), expected)
    with (tmp_path / "runs.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == records
    rows = table(records).splitlines()
    assert len(rows) == 4 and rows[3].startswith("| own | oracle | 1 | 1 |")


def test_a_csv_of_another_version_is_refused(own: SequenceSpec, tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("sequence,seed\nown,0\n")
    with pytest.raises(UserError, match="columns"):
        ablate([own], [0], ["graph"], tmp_path)


def test_list_of_sequences(tmp_path: Path) -> None:
    path = tmp_path / "list.yaml"
    path.write_text("- name: a\n  bim: a.ifc\n  storey: Ground\n- {name: b, bim: b.json, scans: s, truth: t.tum}\n")
    first, second = read_specs(path)
    assert (first.storey, first.scans, second.truth) == ("Ground", None, "t.tum")
    for text, what in (
        ("- {name: a, bim: a.ifc, scans: s}", "truth"), ("- {name: a, bim: a.ifc}", "storey"), ("name: a", "list"),
        ("- {name: a, bim: a.ifc, storey: G, colour: red}", "colour"), ("- {name: [", "YAML"),
        ("- {name: a, bim: demo}\n- {name: a, bim: demo}", "same name"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(UserError, match=what):
            read_specs(path)


def test_mistakes_on_the_command_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluation.ablation", "--out", str(tmp_path), "--sequences", "castle"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and "castle" in done.stderr and len(done.stderr.splitlines()) == 1
