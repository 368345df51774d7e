"""The documentation says what is true: its snippets run, its pictures and links are there, its tables are today's."""

import inspect
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from drives import small_drive
from packaging.version import Version
from small_ifc import write_small_ifc
from snippets import KNOWN, ROOT, Block, blocks, call, check_form, run

import factors
import matching
import sgslam
from data.generation.demo_building import write_demo_building
from evaluation.drives import read_specs
from sgslam.config import Config
from sgslam.config.reference import parameters_page

DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
PICTURE_BYTES = 300_000
WHOLE_DRIVES = ("docs/index.md", "docs/own_sensor.md", "docs/own_building.md", "docs/other_slam.md")
INCLUDED = ("ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md")


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def with_snippets() -> list[Any]:
    """The pages that have snippets; those that run whole drives are long."""
    return [
        pytest.param(page, id=name(page), marks=[pytest.mark.long] if name(page) in WHOLE_DRIVES else [])
        for page in PAGES
        if any(blocks(page))
    ]


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages take to be there, under the names that they use."""
    folder, drive = tmp_path_factory.mktemp("material"), small_drive()
    (folder / "scans").mkdir()
    for k, (_, points) in enumerate(drive.scans):
        np.save(folder / f"scans/{k:06d}.npy", points.astype(np.float32))
    (folder / "scans/times.txt").write_text("".join(f"{stamp / 1e9:.3f}\n" for stamp, _ in drive.scans))
    write_small_ifc(folder / "building.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
    (folder / "demo").mkdir()
    write_demo_building(folder / "demo/demo_building.ifc")
    drive.truth.write_tum(folder / "truth.tum")
    (folder / "SCANS").symlink_to("scans")
    (folder / "my_network").symlink_to(ROOT / "matching/weights")
    (folder / "BUILDING.ifc").symlink_to("building.ifc")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        call("sgslam run --scan-dir scans --bim building.ifc --out out")
    return folder


@pytest.fixture
def place(material: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder is one of its own that holds the material."""
    for path in material.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "out").unlink()
    shutil.copytree(material / "out", tmp_path / "out")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("page", with_snippets())
def test_every_snippet_of_the_page_runs(page: Path, place: Path) -> None:
    """In order, in one folder; Python knows the names of the blocks before, and `scans`."""
    names = {"__name__": "snippet", "scans": small_drive().scans}
    for block in blocks(page):
        assert block.language in (*KNOWN, ""), f"{block}: language '{block.language}'"
        try:
            if block.not_run is None:
                run(block, names)
            else:
                check_form(block)
        except (Exception, SystemExit) as error:
            raise AssertionError(f"{block}: {type(error).__name__}: {error}") from error


def test_what_is_not_run_has_a_reason_and_its_form_is_checked(tmp_path: Path) -> None:
    def block(text: str) -> Block:
        return Block(ROOT / "README.md", 1, "bash", text, not_run="a test")

    check_form(block("pip install sgslam && sgslam run --demo"))
    for wrong in ("sgslam run --no-such-option", "sgslam simulate --bim", "if true", "python examples/none.py"):
        with pytest.raises((AssertionError, pytest.fail.Exception)):
            check_form(block(wrong))


def test_yaml_is_yaml_and_a_list_of_sequences_is_one(tmp_path: Path) -> None:
    for page in PAGES:
        for block in blocks(page):
            if block.language == "yaml":
                value = yaml.safe_load(block.text)
                if isinstance(value, list):
                    (tmp_path / "list.yaml").write_text(block.text)
                    assert read_specs(tmp_path / "list.yaml"), block


def test_the_page_of_settings_has_a_whole_row_for_each() -> None:
    page = parameters_page(Config())
    assert not re.findall(r"^\|.*\|  \|$", page, re.MULTILINE), "a setting whose description does not say what it is"
    assert not re.findall(r"^\|.*[^|\n]$", page, re.MULTILINE), "a row that goes on in the next line"


def test_the_page_of_the_api_names_what_is_public() -> None:
    text = (DOCS / "python_api.md").read_text().replace("\n", " ")
    for name in (*sgslam.__all__, *matching.__all__):
        assert f"`{name}`" in text, name
    for name in factors.__all__:
        arguments = ", ".join(inspect.signature(getattr(factors, name)).parameters)
        assert f"`{name}({arguments})`" in text, name


def test_the_version_is_the_changelogs_newest() -> None:
    told = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert told == sorted(told, key=Version, reverse=True)
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"] == told[0]


def test_pictures_are_there_and_small_and_links_lead_somewhere() -> None:
    for page in (*PAGES, *(ROOT / included for included in INCLUDED)):
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
            assert "://" in target or (page.parent / target).is_file(), f"{name(page)}: {target}"
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < PICTURE_BYTES, picture.name
        assert any(f"pictures/{picture.name}" in page.read_text() for page in PAGES), f"{picture.name} is not shown"


@pytest.mark.skipif(find_spec("zensical") is None, reason="zensical, which builds the site, is not installed")
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    for part in ("mkdocs.yml", *INCLUDED):
        shutil.copy(ROOT / part, tmp_path)
    shutil.copytree(DOCS, tmp_path / "docs")
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    nav = re.findall(r"^ +- .*: (.+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    assert sorted(nav) == sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))
    for page in nav:
        built = tmp_path / "site" / page.removesuffix(".md").removesuffix("index") / "index.html"
        html = built.read_text()
        assert "--8&lt;--" not in html and "--8<--" not in html, page
        for source in re.findall(r'<img[^>]* src="([^":]+)"', html):
            assert (built.parent / source).is_file(), f"{page}: {source}"
