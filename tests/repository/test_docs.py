"""The documentation says what is true: its snippets run, its links lead somewhere, its tables are of this version.

Notebooks are pages whose code cells are snippets.

A comment on the line before a block says what is special about it:

    <!-- not run: why -->    only its form is checked
    <!-- file: my.yaml -->   it is written to that file, for the blocks after it
"""

import argparse
import json
import os
import inspect
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
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
from data.generation.demo_building import write_demo_building
from sgslam.config import Config
from sgslam.config.reference import parameters_page

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *ROOT.glob("*.md"), *DOCS.rglob("*.ipynb")])
KNOWN = ("bash", "sh", "python", "yaml", "json", "text", "")
MARK = re.compile(r"<!-- (not run|file): (.+) -->")


@dataclass(frozen=True)
class Block:
    """A fenced block; `where` is its page and line. `mark` is `not run` or `file`, with what it says."""

    where: str
    language: str
    text: str
    mark: tuple[str, str] | None

    def shell_lines(self) -> list[str]:
        """Its commands: continued lines are joined, comments left out."""
        lines = self.text.replace("\\\n", " ").splitlines() if self.language in ("bash", "sh") else []
        return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page, in order."""
    if page.suffix == ".ipynb":
        for n, cell in enumerate(json.loads(page.read_text())["cells"]):
            if cell["cell_type"] == "code":
                assert cell["outputs"] == [] and cell["execution_count"] is None, f"{name(page)}: kept with its outputs"
                yield Block(f"{name(page)}:{n}", "python", "".join(cell["source"]), None)
        return
    lines, fence = page.read_text(encoding="utf-8").splitlines(), None
    for number, line in enumerate(lines):
        if line.lstrip().startswith("```"):
            if fence is None:
                fence = number
                continue
            indent = len(lines[fence]) - len(lines[fence].lstrip())
            text = "".join(f"{inner[indent:]}\n" for inner in lines[fence + 1 : number])
            mark = MARK.search(lines[fence - 1]) if fence else None
            language = lines[fence].strip().strip("`").strip()
            yield Block(f"{name(page)}:{fence + 1}", language, text, mark and (mark[1], mark[2]))
            fence = None
    assert fence is None, f"{page}: a block does not end"


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


def check_form(block: Block) -> None:
    """That a block could be run: Python compiles, bash parses, YAML loads, our commands take these arguments."""

    def parse(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> None:
        with pytest.MonkeyPatch.context() as within:
            within.setattr(Parser, "parse_known_args", argparse.ArgumentParser.parse_known_args)
            argparse.ArgumentParser.parse_args(parser, *given, **named)
        raise ParsedError

    assert block.language in KNOWN, block
    if block.language == "python":
        compile(block.text, block.where, "exec")
    elif block.language == "yaml":
        yaml.safe_load(block.text)
    elif block.language in ("bash", "sh"):
        done = subprocess.run(["bash", "-n"], input=block.text, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{block.where}: {done.stderr}"
    for part in (part for line in block.shell_lines() for part in re.split(r"&&|\|\||;|\||\s&|>", line)):
        words = ours(shlex.split(part, comments=True))
        if words is not None and words[0] != "-m":
            assert (ROOT / words[0]).is_file(), part
        elif words is not None:
            with pytest.MonkeyPatch.context() as patch, pytest.raises(ParsedError):
                patch.setattr(Parser, "parse_args", parse)
                done = called(*words[1:])
                pytest.fail(f"{block.where}: {part}: {done.stderr}")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_snippet_has_the_form_of_what_can_be_run(page: Path) -> None:
    for block in blocks(page):
        check_form(block)


def test_a_snippet_of_the_wrong_form_is_found() -> None:
    for text in ("pip install sgslam && sgslam run --demo", "python -m data.simulate --bim demo.ifc --out o"):
        check_form(Block("here", "bash", text, None))
    for text in ("sgslam run --no-such-option", "sgslam simulate --bim", "if true", "python examples/none.py"):
        with pytest.raises((AssertionError, pytest.fail.Exception)):
            check_form(Block("here", "bash", text, None))


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
    for link, target in (("SCANS", "scans"), ("BUILDING.ifc", "building.ifc"), ("my_network", "matching/weights")):
        (folder / link).symlink_to(ROOT / target if "/" in target else target)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        call("sgslam run --scan-dir scans --bim building.ifc --out out")
    return folder


RUNNABLE = [page for page in PAGES if any(block.language in ("bash", "sh", "python") for block in blocks(page))]


@pytest.mark.long
@pytest.mark.parametrize("page", RUNNABLE, ids=name)
def test_every_snippet_of_the_page_runs(page: Path, material: Path, tmp_path: Path, monkeypatch: Any) -> None:
    """In order, in one folder; Python knows the names of the blocks before, and `scans`."""
    shutil.copytree(material, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names = {"__name__": "snippet", "scans": small_drive().scans}
    for block in blocks(page):
        mark, text = block.mark or ("", "")
        if mark == "file":
            Path(text).write_text(block.text)
        elif not mark and block.language == "python":
            exec(compile(block.text, block.where, "exec"), names)
        elif not mark:
            for line in block.shell_lines():
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


@pytest.mark.slow
@pytest.mark.skipif(find_spec("zensical") is None, reason="zensical, which builds the site, is not installed")
def test_the_site_builds_without_a_warning_and_holds_every_page(tmp_path: Path) -> None:
    for part in (*ROOT.glob("*.md"), ROOT / "mkdocs.yml"):
        shutil.copy(part, tmp_path)
    shutil.copytree(DOCS, tmp_path / "docs")
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    nav = re.findall(r"^ +- .*: (.+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    assert sorted(nav) == sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))
