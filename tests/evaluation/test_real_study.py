"""The study of recordings of real buildings, on simulated drives that are laid out as the data sets are."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import refused
from drives import CARRIER, SENSOR
from slabim_form import SESSION, write_slabim
from small_ifc import write_small_ifc

from data.datasets import data_set_in
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from evaluation.__main__ import main
from evaluation.buildings import plan_graph
from evaluation.rows import read_rows
from evaluation.studies.real import STUDY, claims


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one's own: a plan, scans, poses and the list."""
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "plan.ifc", site=(300.0, -200.0, 4.0), yaw=0.5)
    run = simulate(building.path, "Ground", folder / "run", 3, 3, 20.0, SENSOR, CARRIER, seconds=16.0)
    shutil.move(folder / "run/scans", folder / "scans")
    run.truth.write_tum(folder / "truth.tum")
    (folder / "sequences.yaml").write_text("- {name: small, bim: plan.ifc, scans: scans, truth: truth.tum}\n")
    return folder


@pytest.mark.slow
def test_a_recording_is_measured_as_a_whole_and_in_pieces(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "real", "--dataset", str(own), "--set", "pieces=[4]", "--rows", str(tmp_path), "--jobs", "1"]
    for to_compute in (2, 0):
        assert main([*words, "--work", str(tmp_path / "work")]) == 0
        assert f"2 cases, {to_compute} to compute" in capsys.readouterr().out
    (whole, pieces), truth = read_rows(tmp_path / "real.jsonl"), Trajectory.read_tum(own / "truth.tum")
    assert (whole.case["building"], whole.case["sequence"]) == ("plan.ifc", "small")
    assert whole.record["anchored"] == 1 and whole.record["scans"] == whole.record["true"] == len(truth)
    assert whole.record["placed"] > 0.9 * len(truth) and whole.record["rmse_m"] < 0.05
    assert whole.record["aligned_rmse_m"] < 0.05 and whole.record["ends"][0][0] < 0.05
    assert np.hypot(whole.record["plan_view_m"], whole.record["height_m"]) == pytest.approx(whole.record["rmse_m"])
    way = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1).sum()
    assert pieces.record["runs"] == way // 4.0 >= 2 and pieces.record["aligned_rmse_m"] is None
    assert len(pieces.record["ends"]) == pieces.record["anchored"] <= pieces.record["runs"]
    assert 0.5 * len(truth) < pieces.record["scans"] < len(truth)  # the rest at the end is shorter than a piece
    assert main(["render", "--rows", str(tmp_path)]) == 0
    assert f"| small | {len(truth)} | 1/1 | 1/1 | 1/1 |" in (tmp_path / "real.md").read_text()


@pytest.mark.slow
def test_a_session_of_slabim_is_laid_out(tmp_path: Path) -> None:
    found = data_set_in(write_slabim(tmp_path))
    found.check(SESSION)
    recording = found.open(SESSION, tmp_path / "work")
    assert len(recording.scans) == len(recording.truth) > 15
    assert len(plan_graph(recording.plan).rooms) == 3


def test_runs_that_are_not_anchored_are_no_success() -> None:
    def row(piece_m: float | None, runs: int, *ends: tuple[float, float]) -> dict[str, object]:
        case = {"dataset": "SLABIM", "building": "b", "sequence": "a", "piece_m": piece_m}
        return {**case, "runs": runs, "true": 100, "placed": 90, "anchored": len(ends), "ends": ends, "rmse_m": 0.1}

    whole = [row(None, 1, (0.29, 0.99)), row(None, 1, (2.9, 4.9)), row(None, 1, (0.31, 0.1)), row(None, 1)]
    rows = pd.DataFrame([*whole, row(15.0, 4, (0.1, 1.1), (3.1, 0.1), (0.1, 5.1))])
    line, pieces = STUDY.tables(rows)["datasets"].iloc[0], STUDY.tables(rows)["pieces"].iloc[0]
    within = ["anchored", "ends within 3 m, 5 deg", "ends within 0.3 m, 1 deg"]
    assert line[within].tolist() == ["3/4", "3/4", "1/4"] and line["coverage (%)"] == "90.0"
    assert pieces[within].tolist() == ["3/4", "1/4", "0/4"]
    assert [claim.value for claim in claims(rows)] == ["3/4", "1/4", "0.100 (0.100–0.100)"]


def test_mistakes_are_one_line(own: Path, tmp_path: Path) -> None:
    run = ("evaluation", "run", "real", "--rows", tmp_path / "rows")
    assert "--dataset DIR" in refused(*run)
    assert "no such folder" in refused(*run, "--dataset", tmp_path / "none")
    assert "add sequences.yaml" in refused(*run, "--dataset", tmp_path)
    assert "there are: small" in refused(*run, "--dataset", own, "--set", "sequences=[large]")
    assert "trust has no option 'dataset'" in refused("evaluation", "run", "trust", "--dataset", own)
