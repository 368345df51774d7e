"""The harness: whatever interrupts a run, its rows are those of an uninterrupted one; pages are made from rows."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from draws import STUDY, Choice

from data.common.errors import UserError
from evaluation.__main__ import main
from evaluation.harness.comparison import compare
from evaluation.harness.provenance import Provenance
from evaluation.harness.rendering import Renderer
from evaluation.harness.row_file import Row, finish, read_rows, rows_path
from evaluation.harness.running import Place, run_study

HELPERS = Path(__file__).resolve().parents[1] / "helpers"
COMMAND = "python -m evaluation run draws"


def values(path: Path) -> dict[str, tuple[object, ...]]:
    """What must be the same in every run: all but the seconds."""
    return {row.key: tuple(v for k, v in row.record.items() if k != "seconds") for row in read_rows(path)}


def run(rows: Path, *seeds: int, **options: object) -> dict[str, tuple[object, ...]]:
    """Runs the study of draws in this process's children."""
    chosen = Choice(seeds=seeds or tuple(range(30)), pause=0.0, **options)  # type: ignore[arg-type]
    run_study(STUDY, chosen, True, Place(rows, rows / "work", 2), COMMAND)
    return values(rows_path(rows, "draws"))


@pytest.mark.long
def test_a_run_killed_at_three_moments_has_the_same_rows(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole")
    place = tmp_path / "killed"
    part = rows_path(place, "draws.part")
    # 30 cases of 0.1 s in two processes
    command = [sys.executable, "-m", "evaluation", "run", "draws", "--rows", str(place), "--jobs", "2"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS.parents[1]), str(HELPERS)])}
    for least in (1, 8, 20):
        process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
        while not part.exists() or part.read_bytes().count(b"\n") < least:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not rows_path(place, "draws").exists()
        part.write_bytes(part.read_bytes() + b'{"case": {"seed"')  # the line that was being written
    kept = part.read_bytes().count(b"\n")
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert f"30 cases, {30 - kept} to compute" in done.stdout
    # the pause is part of the case, the rows are the same otherwise
    found = values(rows_path(place, "draws"))
    assert list(found.values()) == list(whole.values())
    assert not part.exists()


@pytest.mark.long
@pytest.mark.slow
def test_a_cluster_whose_worker_is_killed_has_the_same_rows(tmp_path: Path, scheduler: str) -> None:
    from distributed import Client

    whole = run(tmp_path / "whole")
    command = [sys.executable, "-m", "evaluation", "run", "draws", "--rows", str(tmp_path), "--scheduler", scheduler]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS.parents[1]), str(HELPERS)])}
    with Client(scheduler) as client:
        pids = list(client.run(os.getpid).values())
        process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
        part = rows_path(tmp_path, "draws.part")
        while not part.exists() or part.read_bytes().count(b"\n") < 3:
            assert process.poll() is None
            time.sleep(0.02)
        os.kill(pids[0], signal.SIGKILL)
        assert process.wait(120) == 0
    assert list(values(rows_path(tmp_path, "draws")).values()) == list(whole.values())


def test_rows_of_this_build_are_not_computed_again_and_others_are(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    path = rows_path(tmp_path, "draws")
    first, second = read_rows(path)
    old = second.made.model_copy(update={"build": "00000000"})
    finish(path, [first, Row(second.case, {**second.record, "value": 9.0}, old)])
    comparison = run_study(STUDY, Choice(seeds=(0, 1), pause=0.0), True, Place(tmp_path, tmp_path), "again")
    assert [row.made.command for row in read_rows(path)] == [COMMAND, "again"]
    assert (comparison.common, comparison.moved) == (2, 1)
    assert comparison.fields["value"].cases == 1 and comparison.fields.keys() == {"value"}
    assert "1 of the 2" in comparison.lines()[0] and "value" in comparison.lines()[1]


def test_what_differs_in_seconds_alone_has_not_moved(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    rows = read_rows(rows_path(tmp_path, "draws"))
    slower = [Row(row.case, {**row.record, "seconds": 99.0}, row.made) for row in rows]
    assert not compare(STUDY, rows, slower).moved
    nearly = [Row(row.case, {**row.record, "value": row.record["value"] + 1e-5}, row.made) for row in rows]
    assert compare(STUDY, rows, nearly).moved == 2


def test_part_of_a_study_leaves_the_other_rows_and_the_whole_drops_them(tmp_path: Path) -> None:
    run(tmp_path, 0, 1, 2)
    place = Place(tmp_path, tmp_path)
    run_study(STUDY, Choice(seeds=(7,), pause=0.0), False, place, COMMAND)
    assert [row.case["seed"] for row in read_rows(rows_path(tmp_path, "draws"))] == [0, 1, 2, 7]
    run_study(STUDY, Choice(seeds=(1, 2), pause=0.0), True, place, COMMAND)
    assert [row.case["seed"] for row in read_rows(rows_path(tmp_path, "draws"))] == [1, 2]


def test_cases_whose_files_are_absent_are_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not run(tmp_path, 0, 1, file="no/such.ifc")
    assert "2 cases are skipped, since they need no/such.ifc" in capsys.readouterr().err
    (tmp_path / "there.ifc").write_text("")
    assert len(run(tmp_path, 0, 1, file=str(tmp_path / "there.ifc"))) == 2


def test_large_files_of_rows_are_compressed_and_read_again(tmp_path: Path) -> None:
    made = Provenance.of(COMMAND)
    rows = [Row({"seed": n, "text": os.urandom(40).hex()}, {"value": 0.5}, made) for n in range(2000)]
    path = finish(rows_path(tmp_path, "draws"), rows)
    assert path.suffix == ".gz" and read_rows(rows_path(tmp_path, "draws")) == rows
    assert finish(rows_path(tmp_path, "draws"), rows[:3]).suffix == ".jsonl"
    assert read_rows(rows_path(tmp_path, "draws")) == rows[:3] and not path.exists()


def test_a_line_that_is_no_row_is_named(tmp_path: Path) -> None:
    path = rows_path(tmp_path, "draws")
    path.write_text('{"case": {}}\n')
    with pytest.raises(UserError, match=r"draws\.jsonl:1"):
        read_rows(path)


def test_blocks_are_rendered_from_rows(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    page = "Mean <!-- rows: draws/value -->9.999<!-- /rows -->.\n<!-- rows: draws/mean --><!-- /rows -->\n"
    renderer = Renderer(tmp_path)
    rendered = renderer.page(page)
    rows = read_rows(rows_path(tmp_path, "draws"))
    mean = sum(row.record["value"] for row in rows) / 2
    assert f"Mean <!-- rows: draws/value -->{mean:.3f}<!-- /rows -->." in rendered
    assert f"| 2 | {mean:.3f} |" in rendered and f"Commit `{rows[0].made.commit}`, 2 rows" in rendered
    assert renderer.page(rendered) == rendered
    assert renderer.page(rendered.replace(f"| {mean:.3f} |", "| 0.001 |")) == rendered  # a number changed by hand
    for wrong in ("draws/other", "no_such_study/mean"):
        with pytest.raises(UserError):
            renderer.page(f"<!-- rows: {wrong} --><!-- /rows -->")


def test_empty_blocks_stay_so_until_their_study_has_rows(tmp_path: Path) -> None:
    page = "<!-- rows: elements/walls --><!-- /rows -->\n"
    assert Renderer(tmp_path).page(page) == page
    for wrong in (page.replace("--><!--", "-->\n| 1 |\n<!--"), page.replace("elements", "no_such_study")):
        with pytest.raises(UserError):
            Renderer(tmp_path).page(wrong)


def test_a_page_that_lists_the_commands_does_not_repeat_them(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    page = "<!-- rows: draws/mean --><!-- /rows -->\n<!-- rows: draws/commands --><!-- /rows -->\n"
    rendered = Renderer(tmp_path).page(page)
    assert rendered.count(COMMAND) == 1 and f"\n- `{COMMAND}`\n" in rendered
    assert Renderer(tmp_path).page(rendered) == rendered


def test_a_table_of_two_builds_is_refused_or_says_so(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    path = rows_path(tmp_path, "draws")
    first, second = read_rows(path)
    other = second.made.model_copy(update={"build": "00000000", "commit": "00000000"})
    finish(path, [first, Row(second.case, second.record, other)])
    page = "<!-- rows: draws/mean --><!-- /rows -->"
    with pytest.raises(UserError, match="2 builds"):
        Renderer(tmp_path).page(page)
    assert "**Rows of 2 commits:**" in Renderer(tmp_path, mixed=True).page(page)


def test_a_cell_of_a_table_stands_within_a_sentence(tmp_path: Path) -> None:
    run(tmp_path, 0, 1)
    renderer = Renderer(tmp_path)
    assert renderer.page("of <!-- rows: draws/mean@0,0 --><!-- /rows --> draws").endswith("-->2<!-- /rows --> draws")
    with pytest.raises(UserError, match=r"draws/mean@1,0.*cells"):
        renderer.page("<!-- rows: draws/mean@1,0 --><!-- /rows -->")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "no_such"], "no study 'no_such'"),
        (["run", "draws", "--set", "sedes=[1]"], "draws has no option 'sedes'"),
        (["run", "draws", "--set", "seeds=x"], "seeds"),
        (["run", "draws", "--jobs", "0"], "--jobs 0"),
        (["run", "draws", "--set", "seeds=[]"], "no case"),
    ],
)
def test_a_users_mistake_is_one_line(words: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=message):
        main([*words, *(["--rows", str(tmp_path)] if "run" in words else [])])


@pytest.mark.parametrize("failing", [[], [4]])
def test_a_failed_case_is_named_and_kept_and_the_command_says_so(
    failing: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "draws", "--quick", "--set", "seeds=[4, 5]", f"failing={failing}", "--rows", str(tmp_path)]
    for _ in range(2):  # the second time from the rows
        assert main([*words, "--work", str(tmp_path / "w")]) == bool(failing)
        told = capsys.readouterr().out
        assert ('failed: {"seed":4' in told and "no luck" in told) == bool(failing) and '"seed":5' not in told
        assert len(read_rows(rows_path(tmp_path / "quick", "draws"))) == 2


def test_the_command_runs_a_study_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "draws", "--quick", "--set", "seeds=[4, 5]", "--rows", str(tmp_path), "--work", str(tmp_path / "w")]
    assert main(words) == 0
    assert "draws: 2 cases; 0 of the 0 with a row before have moved" in capsys.readouterr().out
    assert main(["render", "--rows", str(tmp_path / "quick")]) == 0
    assert "| 2 | " in (tmp_path / "quick/draws.md").read_text()
    assert r"\toprule" in (tmp_path / "quick/draws.tex").read_text()
    rows = read_rows(rows_path(tmp_path / "quick", "draws"))
    assert {row.made.command for row in rows} == {"python -m evaluation run draws --quick --set 'seeds=[4, 5]'"}
