"""The snippets of the documentation: fenced blocks of its pages, and how each is run.

A comment on the line before a block says what is special about it:

    <!-- not run: why -->    its form alone is checked
    <!-- file: my.yaml -->   it is written to that file, for the blocks after it
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from commands import called

from data.common.build import PACKAGES
from data.common.cli import Parser

ROOT = Path(__file__).resolve().parents[2]
SHELL, PYTHON = ("bash", "sh"), ("python",)
KNOWN = (*SHELL, *PYTHON, "yaml", "json", "text")
_MARK = re.compile(r"<!-- (not run|file): (.+) -->")


@dataclass(frozen=True)
class Block:
    """`line` is that of its fence, from 1. At most one of `not_run` (the reason) and `file` is given."""

    page: Path
    line: int
    language: str
    text: str
    not_run: str | None = None
    file: str | None = None

    def __str__(self) -> str:
        """Where it stands."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page, in order."""
    lines = page.read_text(encoding="utf-8").splitlines()
    fence: int | None = None
    for number, line in enumerate(lines):
        if not line.lstrip().startswith("```"):
            continue
        if fence is None:
            fence = number
            continue
        indent = len(lines[fence]) - len(lines[fence].lstrip())
        text = "\n".join(inner[indent:] for inner in lines[fence + 1 : number]) + "\n"
        mark = _MARK.search(lines[fence - 1]) if fence else None
        told = {mark[1].replace(" ", "_"): mark[2]} if mark else {}
        yield Block(page, fence + 1, lines[fence].strip().strip("`").strip(), text, **told)
        fence = None
    assert fence is None, f"{page}: the block that begins in line {(fence or 0) + 1} does not end"


def shell_lines(text: str) -> list[str]:
    """The commands of a block: lines that go on are joined, comments and empty lines left out."""
    joined = text.replace("\\\n", " ").splitlines()
    return [line.strip() for line in joined if line.strip() and not line.lstrip().startswith("#")]


def run(block: Block, names: dict[str, Any]) -> None:
    """Runs a block in the folder that is the current one; `names` are those that the page's Python knows."""
    if block.file is not None:
        Path(block.file).write_text(block.text)
    elif block.language in PYTHON:
        exec(compile(block.text, str(block), "exec"), names)
    elif block.language in SHELL:
        for line in shell_lines(block.text):
            call(line)


def call(line: str) -> None:
    """Runs a line: our own commands within this process, which has loaded all that they load, others by bash."""
    words = _words(line)
    ours = None if words is None else _ours(words)
    if ours is not None:
        done = _called(ours)
    else:
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PATH": path}
        done = subprocess.run(["bash", "-ec", line], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{line}\n{done.stderr}"


def check_form(block: Block) -> None:
    """That a block that is not run could be: Python compiles, bash parses, our commands take these arguments."""
    if block.language in PYTHON:
        compile(block.text, str(block), "exec")
    if block.language not in SHELL:
        return
    done = subprocess.run(["bash", "-n"], input=block.text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for line in shell_lines(block.text):
        for part in re.split(r"&&|\|\||;|\|", line):
            ours = _ours(shlex.split(part))
            if ours is not None:
                _parsed(ours)


def _words(line: str) -> list[str] | None:
    """None where bash is needed: pipes, redirections, variables, patterns, several commands."""
    return None if re.search(r"[|&;<>$`*~]", line) else shlex.split(line)


def _ours(words: list[str]) -> list[str] | None:
    """The words of a command of ours without the interpreter: `sgslam ...`, `-m MODULE ...`, `examples/FILE.py ...`."""
    name, *rest = (Path(words[0]).name, *words[1:]) if words else ("",)
    if name == "sgslam":
        return words
    if name not in ("python", "python3") or not rest:
        return None
    if rest[0] == "-m" and rest[1].partition(".")[0] in PACKAGES:
        return rest
    return rest if rest[0].startswith("examples/") else None


def _called(words: list[str]) -> CompletedProcess[str]:
    if Path(words[0]).name == "sgslam":
        return called("sgslam.cli.command", *words[1:])
    if words[0] == "-m":
        return called(words[1], *words[2:])
    line = [sys.executable, str(ROOT / words[0]), *words[1:]]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(line, env=environment, capture_output=True, text=True, check=False)


class _ParsedError(Exception):
    """The arguments are well; nothing else is done."""


def _parsed(words: list[str]) -> None:
    def parse(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> None:
        with pytest.MonkeyPatch.context() as within:
            within.setattr(Parser, "parse_known_args", argparse.ArgumentParser.parse_known_args)
            argparse.ArgumentParser.parse_args(parser, *given, **named)
        raise _ParsedError

    def parse_known(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> None:
        argparse.ArgumentParser.parse_known_args(parser, *given, **named)
        raise _ParsedError

    if not words[0].startswith("-") and Path(words[0]).name != "sgslam":
        assert (ROOT / words[0]).is_file(), words[0]
        return
    with pytest.MonkeyPatch.context() as patch, pytest.raises(_ParsedError):
        patch.setattr(Parser, "parse_args", parse)
        patch.setattr(Parser, "parse_known_args", parse_known)
        _called(words)
