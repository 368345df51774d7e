"""The ablation: its list, its rows, its tables and page; killed and resumed; on a user's own sequence."""

import csv
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import called, refused
from drives import SENSOR
from small_ifc import STOREY, write_small_ifc

from data.common.errors import UserError
from data.simulation.simulate import simulate
from evaluation.harness import Conditions, SequenceSpec, prepare, read_specs
from evaluation.slam_ablation.rows import Records
from evaluation.slam_ablation.run import ablate
from evaluation.slam_ablation.tables import ACCURACY, against_oracle, latex, markdown
from evaluation.slam_ablation.variants import check_variant

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    """A short drive as a user's own scans and truth."""
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "small.ifc")
    simulate(building.path, STOREY, folder / "drive", seed=1, min_rooms=1, min_length=6.0, sensor=SENSOR)
    return SequenceSpec(
        "own", str(building.path), scans=str(folder / "drive" / "scans"), truth=str(folder / "drive" / "truth.tum")
    )


@pytest.fixture(scope="module")
def listed(own: SequenceSpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("list") / "list.yaml"
    path.write_text(yaml.safe_dump([{k: v for k, v in asdict(own).items() if v is not None}]))
    return path


def command(listed: Path, out: Path, *more: str) -> list[str]:
    words = [sys.executable, "-m", "evaluation.slam_ablation.run", "--out", str(out), "--list", str(listed)]
    return [*words, "--seeds", "0", "--variants", "odometry", "graph", "oracle", *more]


def without_times(out: Path) -> list[dict[str, str]]:
    with (out / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    changing = [name for name in rows[0] if name.startswith("seconds")] + ["peak_memory_mb", "command"]
    return [{k: v for k, v in row.items() if k not in changing} for row in rows]


@pytest.fixture(scope="module")
def whole(listed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nobody kills, with everything it leaves."""
    out = tmp_path_factory.mktemp("whole")
    page = out / "BENCHMARKS.md"
    done = subprocess.run(command(listed, out, "--benchmarks", str(page)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "min left" in done.stdout
    return out


def test_rows_say_what_was_run_and_how_it_went(whole: Path) -> None:
    with (whole / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [r["arm"] for r in rows] == ["odometry", "graph", "oracle"]
    odometry, graph, oracle = rows
    assert float(graph["rmse_bim_m"]) < 0.05 and graph["anchored"] == "False" and graph["drift_reduction"] == ""
    assert oracle["anchored"] == "True" and float(oracle["rmse_bim_m"]) < 0.03
    expected = 1 - float(oracle["rmse_bim_m"]) / float(graph["rmse_bim_m"])
    assert np.isclose(float(oracle["drift_reduction"]), expected)
    for row in rows:
        assert row["matched_poses"] == row["total_poses"] == row["scans"] != "0"
        assert 30 < float(row["peak_memory_mb"]) < 4000 and float(row["seconds"]) > 0
        assert "--seeds 0 --variants" in row["command"] and row["arm"] in row["command"].split()
    assert odometry["wall_precision"] == "" and float(oracle["wall_precision"]) > 0.5
    assert float(oracle["match_precision"]) > 0.9
    stages = sum(float(oracle[f"seconds_{s}"]) for s in ("odometry", "surfaces", "rooms", "matching", "optimisation"))
    assert stages <= float(oracle["seconds"])
    settings = yaml.safe_load((whole / oracle["config"]).read_text())
    assert settings["ablation"]["arm"] == "oracle" and settings["anchors"]["planes"] is True


def test_the_page_has_tables_and_plots(whole: Path) -> None:
    page = (whole / "ablation.md").read_text()
    assert "| own | normal | oracle | 1 | 1 |" in page and "## Commands" in page
    for line in page.splitlines():
        if line.startswith("!["):
            picture = whole / line.split("(")[-1].rstrip(")")
            assert picture.read_text().lstrip().startswith("<?xml")
    assert r"\toprule" in (whole / "table.tex").read_text()
    section = (whole / "BENCHMARKS.md").read_text()
    assert section.startswith("<!-- ablation -->") and "| own | normal | oracle" in section and "cores" in section
    assert (whole / "docs" / "ablation-drift-reduction.svg").exists()


def test_killed_three_times_and_resumed_it_is_the_same(listed: Path, whole: Path, tmp_path: Path) -> None:
    def rows() -> int:
        return len((tmp_path / "runs.csv").read_text().splitlines()) if (tmp_path / "runs.csv").exists() else 0

    for enough in (lambda: (tmp_path / "configs").exists(), lambda: rows() >= 3, lambda: rows() >= 4):
        run = subprocess.Popen(command(listed, tmp_path), stdout=subprocess.DEVNULL, start_new_session=True)
        while not enough() and run.poll() is None:
            time.sleep(0.02)
        os.killpg(run.pid, signal.SIGKILL)
        assert run.wait() in (-signal.SIGKILL, 0)
    assert called(*command(listed, tmp_path)[2:]).returncode == 0
    assert without_times(tmp_path) == without_times(whole)
    before = (tmp_path / "runs.csv").read_bytes()
    again = called(*command(listed, tmp_path)[2:])
    assert (tmp_path / "runs.csv").read_bytes() == before and "min left" not in again.stdout


def test_by_a_cluster_it_is_the_same(scheduler: str, listed: Path, whole: Path, tmp_path: Path) -> None:
    ablate(read_specs(listed), [0], ["oracle"], tmp_path, scheduler=scheduler)
    (found,), expected = without_times(tmp_path), without_times(whole)[-1]
    assert found == expected | {"drift_reduction": ""}  # the graph without anchors has not been run
    for name in ("errors/own_normal_0_oracle.csv", found["config"]):
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes()


def test_a_csv_of_another_version_is_refused(own: SequenceSpec, tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("sequence,seed\nown,0\n")
    with pytest.raises(UserError, match="columns"):
        ablate([own], [0], ["graph"], tmp_path)


def test_what_a_run_refuses_reaches_the_user(own: SequenceSpec, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="not simulated"):
        ablate([own], [0], ["graph"], tmp_path, Conditions(moved_walls=0.3))


def test_a_weak_front_end_has_an_odometry_of_its_own(own: SequenceSpec, tmp_path: Path) -> None:
    sequence = prepare(own, 0, tmp_path, Conditions(weaken=True))
    assert sequence.weak is not None and len(sequence.weak.trajectory) == len(sequence.truth)
    kept = tmp_path / "own-0.odometry.tum"
    before = kept.stat().st_mtime_ns
    again = prepare(own, 0, tmp_path, Conditions(weaken=True))
    assert again.weak is not None and again.weak.rmse_m == sequence.weak.rmse_m > 0.5
    assert kept.stat().st_mtime_ns == before
    assert prepare(own, 0, tmp_path).weak is None


def test_list_of_sequences(tmp_path: Path) -> None:
    path = tmp_path / "list.yaml"
    path.write_text("- name: a\n  bim: a.ifc\n  storey: Ground\n- {name: b, bim: b.json, scans: s, truth: t.tum}\n")
    first, second = read_specs(path)
    assert (first.storey, first.scans, second.truth) == ("Ground", None, "t.tum")
    path.write_text("- {name: a, bim: mesh.stl}")
    assert read_specs(path)[0].is_mesh
    for text, what in (
        ("- {name: a, bim: a.ifc, scans: s}", "truth"), ("- {name: a, bim: a.ifc}", "storey"), ("name: a", "list"),
        ("- {name: a, bim: a.ifc, storey: G, colour: red}", "colour"), ("- {name: [", "YAML"),
        ("- {name: a, bim: demo}\n- {name: a, bim: demo}", "same name"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(UserError, match=what):
            read_specs(path)


def records(**errors: list[float]) -> Records:
    """Runs of variants with these errors."""
    return [
        {
            **dict.fromkeys(ACCURACY, ""), "sequence": "a_b", "conditions": "normal", "arm": variant, "seed": str(seed),
            "rmse_bim_m": str(error), "anchored": "True", "matched_poses": "9", "total_poses": "10", "weakening": "",
        }
        for variant, own in errors.items()
        for seed, error in enumerate(own)
    ]  # fmt: skip


def test_tables_give_mean_and_deviation_over_the_seeds() -> None:
    some = records(anchored=[0.01, 0.02, 0.03], oracle=[0.01, 0.01, 0.01])
    first = markdown(some, ACCURACY).splitlines()[2]
    assert first.startswith("| a_b | normal | anchored | 3 | 3 | 27 of 30 | 0.02 ± 0.01 |")
    assert r"a\_b & normal & anchored & 3 & 3 & 27 of 30 & 0.02 $\pm$ 0.01 &" in latex(some, ACCURACY)
    assert "| 0.0200 | 0.0100 | +100 % |" in against_oracle(some)
    assert against_oracle(records(anchored=[0.01])) == ""


def test_mistakes_on_the_command_line(tmp_path: Path) -> None:
    assert "castle" in refused("evaluation.slam_ablation.run", "--out", tmp_path, "--sequences", "castle")
    unknown, no_method = "unknown variant", "no matching method"
    for variant, what in (("fast", unknown), ("oracle:x", unknown), ("anchored:guessing", no_method)):
        with pytest.raises(UserError, match=what):
            check_variant(variant)
    with pytest.raises(UserError, match="share"):
        Conditions(moved_walls=2.0)


def test_conditions_are_told_by_their_options() -> None:
    assert Conditions().name == "normal" and not list(Conditions().options())
    hard = Conditions(weaken=True, moved_walls=0.33, wrong_matches=2, loops=True)
    assert list(hard.options()) == ["--weaken", "--moved-walls 0.33", "--wrong-matches 2", "--loops"]
    assert hard.name == "weaken moved-walls-0.33 wrong-matches-2 loops" and hard.of_the_drive == "-moved0.33-loops"
