"""The harness: whatever interrupts a run, its rows are those of an uninterrupted one; pages are made from rows."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from draws import STUDY, Choice

from data.common.errors import UserError
from evaluation.__main__ import main
from evaluation.render import Renderer
from evaluation.rows import Provenance, Row, finish, read_rows, rows_path
from evaluation.running import Place, run_study
from evaluation.tables import Query, count, often, over_buildings, rare, spread_of

HELPERS = Path(__file__).resolve().parents[1] / "helpers"
COMMAND = "python -m evaluation run draws"


def values(path: Path) -> list[float]:
    return [row.record["value"] for row in read_rows(path)]


def run(rows: Path, *seeds: int, **options: object) -> list[float]:
    chosen = Choice(seeds=seeds or tuple(range(30)), pause=0.0, **options)  # type: ignore[arg-type]
    run_study(STUDY, chosen, Place(rows, rows / "work", 2), COMMAND)
    return values(rows_path(rows, "draws"))


@pytest.mark.long
@pytest.mark.parametrize("on_cluster", [False, True])
def test_an_interrupted_run_has_the_rows_of_a_whole_one(
    on_cluster: bool, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    whole = run(tmp_path / "whole")
    part = rows_path(tmp_path, "draws.part")
    command = [sys.executable, "-m", "evaluation", "run", "draws", "--rows", str(tmp_path)]
    command += ["--scheduler", request.getfixturevalue("scheduler")] if on_cluster else ["--jobs", "2"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS.parents[1]), str(HELPERS)])}
    for least in (1, 8, 20):
        process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
        while not part.exists() or part.read_bytes().count(b"\n") < least:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.wait()
        part.write_bytes(part.read_bytes() + b'{"case": {"seed"')  # the line that was being written
    kept = part.read_bytes().count(b"\n")
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert f"30 cases, {30 - kept} to compute" in done.stdout
    assert values(rows_path(tmp_path, "draws")) == whole and not part.exists()


def test_what_is_computed_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, 0, 1, 2)
    path, place = rows_path(tmp_path, "draws"), Place(tmp_path, tmp_path / "work")
    rows = read_rows(path)
    other = rows[1].made.model_copy(update={"build": "00000000"})
    finish(path, [rows[0], Row(rows[1].case, {**rows[1].record, "value": 9.0}, other), rows[2]])
    run_study(STUDY, Choice(seeds=(0, 1), pause=0.0), place, "again")
    assert [row.made.command for row in read_rows(path)] == [COMMAND, "again"]  # of this build, of another, not listed
    run_study(STUDY, Choice(seeds=(7,), pause=0.0), place, COMMAND, whole=False)
    assert [row.case["seed"] for row in read_rows(path)] == [0, 1, 7]
    assert not list((tmp_path / "work").iterdir())  # groups are released
    capsys.readouterr()
    assert not run(tmp_path / "absent", 0, 1, file="no/such.ifc")
    assert "2 cases are skipped, since they need no/such.ifc" in capsys.readouterr().err


def test_a_failed_case_is_named_kept_and_tried_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "draws", "--quick", "--set", "seeds=[4, 5]", "failing=[4]", "--rows", str(tmp_path)]
    path = rows_path(tmp_path / "quick", "draws")
    for _ in range(2):  # a failed case is measured again, the other is not
        assert main([*words, "--work", str(tmp_path / "w")]) == 1
        out = capsys.readouterr().out
        assert '"seed":4' in out and "no luck" in out and '"seed":5' not in out
        assert [row.failed for row in read_rows(path)] == [True, False]
    assert "2 cases, 1 to compute" in out
    assert "1 rows, 1 more failed" in Renderer(tmp_path).page("<!-- rows: draws/mean -->x<!-- /rows -->")


def test_files_of_rows(tmp_path: Path) -> None:
    made = Provenance.of(COMMAND, ("factors",))
    rows = [Row({"seed": n, "text": os.urandom(40).hex()}, {"value": 0.5}, made) for n in range(2000)]
    path = finish(rows_path(tmp_path, "draws"), rows)
    assert path.suffix == ".gz" and read_rows(rows_path(tmp_path, "draws")) == rows
    assert finish(rows_path(tmp_path, "draws"), rows[:3]).suffix == ".jsonl"
    assert read_rows(rows_path(tmp_path, "draws")) == rows[:3] and not path.exists()
    rows_path(tmp_path, "draws").write_text('{"case": {}}\n')
    with pytest.raises(UserError, match=r"draws\.jsonl:1"):
        read_rows(rows_path(tmp_path, "draws"))


def test_blocks_are_rendered_from_rows(tmp_path: Path) -> None:
    mean = float(np.mean(run(tmp_path, 0, 1)))
    page = "Mean <!-- rows: draws/value -->9.999<!-- /rows -->.\n<!-- rows: draws/mean --><!-- /rows -->\n"
    page += "<!-- rows: draws/commands --><!-- /rows -->\nOf <!-- rows: draws/mean@0,0 --><!-- /rows --> draws"
    renderer, made = Renderer(tmp_path), read_rows(rows_path(tmp_path, "draws"))[0].made
    rendered = renderer.page(page)
    assert f"Mean <!-- rows: draws/value -->{mean:.3f}<!-- /rows -->." in rendered
    assert f"| 2 | {mean:.3f} |" in rendered and f"Commit `{made.commit}`, 2 rows" in rendered
    assert f"\n- `{COMMAND}`\n" in rendered and "-->2<!-- /rows --> draws" in rendered
    assert renderer.page(rendered) == rendered
    assert renderer.page(rendered.replace(f"| {mean:.3f} |", "| 0.001 |")) == rendered  # a number changed by hand
    for wrong in ("draws/other", "no_such_study/mean", "draws/mean@1,0"):
        with pytest.raises(UserError):
            renderer.page(f"<!-- rows: {wrong} --><!-- /rows -->")
    empty = "<!-- rows: elements/walls --><!-- /rows -->\n"  # a study that is still to be run
    assert Renderer(tmp_path / "none").page(empty) == empty
    with pytest.raises(UserError):
        Renderer(tmp_path / "none").page(empty.replace("--><!--", "-->\n| 1 |\n<!--"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["no_such"], "no study 'no_such'"),
        (["draws", "--set", "sedes=[1]"], "draws has no option 'sedes'"),
        (["draws", "--set", "seeds=x"], "seeds"),
        (["draws", "--jobs", "0"], "--jobs 0"),
        (["draws", "--set", "seeds=[]"], "no case"),
        (["trust", "--quick", "--set", "buildings=[castle]"], "no building 'castle'"),
        (["real"], "--dataset DIR"),
    ],
)
def test_a_users_mistake_is_one_line(words: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=message):
        main(["run", *words, "--rows", str(tmp_path), "--work", str(tmp_path)])


def test_the_command_runs_a_study_of_ones_own(tmp_path: Path) -> None:
    words = ["run", "draws", "--quick", "--set", "seeds=[4, 5]", "--rows", str(tmp_path), "--work", str(tmp_path / "w")]
    assert main(words) == 0 and main(["render", "--rows", str(tmp_path / "quick")]) == 0
    assert "| 2 | " in (tmp_path / "quick/draws.md").read_text()
    assert r"\toprule" in (tmp_path / "quick/draws.tex").read_text()
    rows = read_rows(rows_path(tmp_path / "quick", "draws"))
    assert {row.made.command for row in rows} == {"python -m evaluation run draws --quick --set 'seeds=[4, 5]'"}


def test_units_of_bounds_are_buildings() -> None:
    event = pd.Series([True, False, True, False] * 25)
    few, several = pd.Series(["a", "b", "c", "d"] * 25), pd.Series([f"b{k % 10}" for k in range(100)])
    assert rare(event, few) == "50/100 runs, 2/4 buildings"  # however many rows: four buildings bound nothing
    assert rare(event, several) == "50/100 runs, 5/10 buildings (≤ 81 %)"  # Clopper and Pearson, 97.5 %
    assert often(~event, few) == "50/100 runs, 2/4 buildings"
    assert rare(event[:0], few[:0]) == ""
    spread_over = over_buildings(pd.Series(np.arange(100.0)), several)
    assert spread_over is not None and spread_over.low < 49.5 < spread_over.high
    alone = over_buildings(pd.Series(np.arange(100.0)), few)
    assert alone is not None and alone.value == 49.5 and np.isnan(alone.low)


def test_a_query_groups_filters_and_leaves_out_what_is_unknown() -> None:
    rows = pd.DataFrame({"kind": ["a", "b", "a"], "error": [1.0, None, 3.0], "building": ["x", "y", "z"]})
    columns = {
        "runs": count(),
        "known": count(lambda own: own.error.notna()),
        "error": lambda own: spread_of(own.error),
    }
    table = Query({"kind": "what"}, columns, lambda own: own.kind.eq("a") | own.error.isna()).table(rows)
    assert table.to_numpy().tolist() == [["a", "2", "2/2", "2 (1–3)"], ["b", "1", "0/1", ""]]
    same = Query({"place": "where", "kind": "what"}, columns).table(rows.assign(place="here"))
    assert same.columns.tolist() == ["what", *columns]  # "where" is the same in all lines
    assert spread_of(pd.Series([np.inf, 1.0, np.inf])) == "lost (1–lost)"
