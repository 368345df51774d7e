"""The documentation says what is true: its snippets run, its links lead somewhere, its tables are of this version.

A comment on the line before a block says what is special about it: `<!-- not run: why -->`, and
`<!-- file: my.yaml -->` of one that is written to that file, for the blocks after it.
"""

import argparse
import inspect
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import called
from drives import small_drive
from small_ifc import write_small_ifc

import factors
import matching
import sgslam
from data.common.build import PACKAGES
from data.common.cli import Parser
from data.generation import write_demo_building
from sgslam.config import Config
from sgslam.config.documented import parameters_page

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *ROOT.glob("*.md"), *DOCS.rglob("*.ipynb")])
KNOWN = ("bash", "sh", "python", "yaml", "json", "text", "")
FENCED = re.compile(r"(?:<!-- (not run|file): (.+) -->\n)?^ *```(.*)\n((?:.*\n)*?) *```$", re.MULTILINE)


def blocks(page: Path) -> Iterator[tuple[str, str, str, str]]:
    """The fenced blocks of a page, or the cells of a notebook: the mark, what it says, language and text."""
    text = page.read_text()
    if page.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        assert all(cell["outputs"] == [] for cell in cells), f"{page}: kept with its outputs"
        yield from (("", "", "python", "".join(cell["source"])) for cell in cells)
    for mark, said, language, lines in FENCED.findall(text if page.suffix == ".md" else ""):
        yield mark, said, language, textwrap.dedent(lines)


def shell_lines(language: str, text: str) -> list[str]:
    """The commands of a block: continued lines are joined, comments left out."""
    lines = text.replace("\\\n", " ").splitlines() if language in ("bash", "sh") else []
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def ours(words: list[str]) -> list[str] | None:
    """The words of one of our commands without the interpreter: `sgslam ...`, `-m MODULE ...`, `examples/F.py ...`."""
    program, *rest = (Path(words[0]).name, *words[1:]) if words else ("",)
    if program == "sgslam":
        return ["-m", "sgslam.cli.command", *rest]
    if program in ("python", "python3") and rest:
        module = rest[0] == "-m" and rest[1].partition(".")[0] in PACKAGES
        return rest if module or rest[0].startswith("examples/") else None
    return None


def call(line: str) -> None:
    """Runs a line: our commands within this process, others, and lines with pipes or variables, in bash."""
    words = None if re.search(r"[|&;<>$`*~]", line) else ours(shlex.split(line))
    if words is not None and words[0] == "-m":
        done = called(*words[1:])
    else:
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PATH": path}
        text = line if words is None else shlex.join([sys.executable, str(ROOT / words[0]), *words[1:]])
        done = subprocess.run(["bash", "-ec", text], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{line}\n{done.stderr}"


class ParsedError(Exception):
    """The arguments are accepted; nothing is run."""


def parsed(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> None:
    with pytest.MonkeyPatch.context() as within:
        within.setattr(Parser, "parse_known_args", argparse.ArgumentParser.parse_known_args)
        argparse.ArgumentParser.parse_args(parser, *given, **named)
    raise ParsedError


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_snippet_has_the_form_of_what_can_be_run(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python compiles, our commands take these arguments."""
    monkeypatch.setattr(Parser, "parse_args", parsed)
    for _, _, language, text in blocks(page):
        if language == "python":
            compile(text, page, "exec")
        for part in (part for line in shell_lines(language, text) for part in re.split(r"&&|;|\||\s&|>", line)):
            words = ours(shlex.split(part, comments=True))
            if words is not None and words[0] != "-m":
                assert (ROOT / words[0]).is_file(), part
            elif words is not None:
                with pytest.raises(ParsedError):
                    pytest.fail(f"{part}: {called(*words[1:]).stderr}")


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
    for link, target in (("SCANS", "scans"), ("BUILDING.ifc", "building.ifc"), ("my_judge", "matching/weights")):
        (folder / link).symlink_to(ROOT / target if "/" in target else target)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        call("sgslam run --scan-dir scans --bim building.ifc --out out")
    return folder


RUNNABLE = [page for page in PAGES if any(block[2] in ("bash", "sh", "python") for block in blocks(page))]


@pytest.mark.long
@pytest.mark.parametrize("page", RUNNABLE, ids=name)
def test_every_snippet_of_the_page_runs(page: Path, material: Path, tmp_path: Path, monkeypatch: Any) -> None:
    """In order, in one folder; Python knows the names of the blocks before, and `scans`."""
    shutil.copytree(material, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names = {"__name__": "snippet", "scans": small_drive().scans}
    for mark, said, language, text in blocks(page):
        if mark == "file":
            Path(said).write_text(text)
        elif not mark and language == "python":
            exec(compile(text, page, "exec"), names)
        elif not mark:
            for line in shell_lines(language, text):
                call(line)


def test_tables_of_parameters_and_versions_are_current() -> None:
    page = parameters_page(Config())
    assert "| `" in page
    assert not re.findall(r"^\|.*(?:\|  \||[^|\n])$", page, re.MULTILINE)  # a setting without a description
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert re.search(r"^## \[?(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == version  # type: ignore[index]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version


def test_the_page_of_the_api_names_what_is_public() -> None:
    text = (DOCS / "python_api.md").read_text().replace("\n", " ")
    for name in (*sgslam.__all__, *matching.__all__):
        assert f"`{name}`" in text, name
    for name in factors.__all__:
        arguments = ", ".join(inspect.signature(getattr(factors, name)).parameters)
        assert f"`{name}({arguments})`" in text, name


def test_links_and_pictures_lead_somewhere() -> None:
    shown = set()
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
            assert "://" in target or (page.parent / target).is_file(), f"{name(page)}: {target}"
            shown.add((page.parent / target).resolve())
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < 300_000 and picture in shown, picture.name
