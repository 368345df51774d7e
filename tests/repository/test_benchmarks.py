"""The pages of results say what the rows say."""

import re
from pathlib import Path

import pytest

from evaluation.harness.rendering import BLOCK, PLOTS, ROOT, Renderer, pages
from evaluation.harness.row_file import read_rows, rows_path
from evaluation.harness.running import QUICK, ROWS
from evaluation.harness.study import STUDIES, load_study

NOT_MEASURED = "\nNothing was measured: "  # on the page of a study without rows, in place of its tables
RENDER = "written by hand, or rows changed: python -m evaluation render"


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer()


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_page_says_what_the_rows_say(page: Path, renderer: Renderer) -> None:
    text = page.read_text()
    assert renderer.page(text) == text, RENDER


def test_a_number_changed_by_hand_is_found(renderer: Renderer) -> None:
    text = (ROOT / "README.md").read_text()
    block = next(found[0] for found in BLOCK.finditer(text) if (found[2], found[3]) == ("ablation", "readme"))
    number = re.findall(r"0\.\d+", block)[-1]
    changed = text.replace(block, block.replace(number, number[:-1] + str((int(number[-1]) + 1) % 10)))
    assert changed != text and renderer.page(changed) == text


def test_the_page_of_results_is_read_in_five_minutes() -> None:
    text = (ROOT / "BENCHMARKS.md").read_text()
    assert len(text.splitlines()) <= 250
    claims, *tables = [found[4] for found in BLOCK.finditer(text)]
    assert claims.count("\n| ") > 8 and len(tables) == 8
    assert all(table.count("\n| ") - 2 <= 12 for table in tables)


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_a_page_with_its_tables(name: str) -> None:
    study, text = load_study(name), (PLOTS / f"{name}.md").read_text()
    assert study.name == name and len(study.asks.split()) > 3
    assert f"python -m evaluation run {name}" in text and f"({name}.md)" in (PLOTS / "index.md").read_text()
    has_tables, has_rows = f"<!-- rows: {name}/" in text, Renderer().has_rows(name)
    assert has_tables == has_rows == (NOT_MEASURED not in text)


@pytest.mark.parametrize("name", STUDIES)
def test_rows_are_of_the_studys_cases(name: str) -> None:
    study = load_study(name)
    for folder in (ROWS, ROWS / QUICK):
        for row in read_rows(rows_path(folder, name)):
            assert study.case.model_validate(row.case).key == row.key
            study.record.model_validate(row.record)


def test_all_tables_are_of_one_commit(renderer: Renderer) -> None:
    measured = filter(renderer.has_rows, STUDIES)
    commits = {commit for name in measured for commit in renderer.rows_of(name)["made.commit"]}
    (commit,) = commits
    assert not commit.endswith("+") and f"`{commit[:8]}`" in (PLOTS / "index.md").read_text()
