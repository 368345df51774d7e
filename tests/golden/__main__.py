"""`python -m tests.golden make --commit C`, then `python -m tests.golden compare`: has anything moved, and by how much?

The results of the commit C, made on this machine, are the reference: A-graphs of all public plans in ../shared/data and
of generated buildings, answers of all matching methods to 400 maps, the output folders of eight runs. `compare` makes
the same by the code of this checkout, or by other code (--code, --commit), of the same maps and drives. It prints
"bit-equal" or what moved, and ends with 0 if all is equal, 1 if anything moved, 2 for a mistake of the user. What is
finished is kept: the same command continues. It is no part of the test suite.
"""

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError

from . import runs, worker
from .differences import match_lines, plan_lines
from .folders import folder_lines

ROOT = Path(__file__).resolve().parents[2]
DATA = (ROOT.parent / "shared" / "data").resolve()
METHODS = ("learned", "voting", "paper", "combinatorial")
ITEMS = (
    *(f"graphs/{name}" for name in worker.SETS), *(f"matches/{name}" for name in METHODS),
    *(f"runs/{name}" for name in runs.RUNS),
)  # fmt: skip
MEASURED = ("data", "matching", "factors", "sgslam")  # the packages whose results these are


@dataclass(frozen=True)
class Code:
    """The code that is measured, in the folder `path`; `work` is for what it keeps."""

    path: Path
    work: Path

    def digest(self) -> str:
        """A hash of its files, which tells one state of a checkout from another."""
        hashed = hashlib.blake2b(digest_size=6)
        for package in MEASURED:
            for file in sorted(p for p in (self.path / package).rglob("*") if "__pycache__" not in p.parts):
                if file.is_file():
                    hashed.update(f"{file.relative_to(self.path)}\0".encode() + file.read_bytes())
        return hashed.hexdigest()

    def python(self, *words: object, code: int = 0) -> None:
        """Runs Python with this code; raises UserError if it does not end with the exit code."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        own = {"PYTHONPATH": str(self.path), "SGSLAM_CACHE_DIR": str(self.work / "plans"), "OMP_NUM_THREADS": "1",
               "TZ": "UTC"}  # fmt: skip
        line = [sys.executable, *map(str, words)]
        done = subprocess.run(
            line, env=kept | own, cwd=self.path, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        if done.returncode != code:
            shown = " ".join(word if "\n" not in word else "..." for word in line[1:])
            raise UserError(f"'python {shown}' ended with {done.returncode}: {runs.last_words(done)}")


@contextmanager
def code_of(options: argparse.Namespace, work: Path) -> Iterator[Path]:
    """The folder with the code that the options name; a commit's is a git worktree that is removed in the end."""
    if options.code is not None or options.commit is None:
        path = (options.code or ROOT).resolve()
        if not all((path / package).is_dir() for package in MEASURED):
            raise UserError(f"--code {path}: give a checkout, with the folders {', '.join(MEASURED)}")
        yield path
        return
    found = _git("rev-parse", "--verify", f"{options.commit}^{{commit}}")
    if found.returncode:
        raise UserError(f"--commit {options.commit}: no such commit")
    path = work / f"code-{found.stdout.strip()[:12]}"
    added = None if path.exists() else _git("worktree", "add", "-f", "--detach", str(path), found.stdout.strip())
    if added is not None and added.returncode:
        raise UserError(f"git worktree add {path}: {runs.last_words(added)}")
    try:
        yield path
    finally:
        _git("worktree", "remove", "--force", str(path))


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True)


def make_item(item: str, code: Code, out: Path, inputs: Path, reference: Path | None) -> bool:
    """Makes one of ITEMS in the folder `out`, unless it is there; whether it can be made, for want of public data.

    The inputs are made too where this is the reference (`reference` None).
    """
    kind, _, name = item.partition("/")
    target, done = out / item, out / f"{item}.done"
    if done.exists():
        return True
    if kind == "runs" and name in runs.PUBLIC and not (DATA / runs.PUBLIC[name]).exists():
        return False
    target.parent.mkdir(parents=True, exist_ok=True)
    inputs.mkdir(parents=True, exist_ok=True)
    began, cpu = time.perf_counter(), _cpu_s()
    if kind == "graphs":
        code.python(worker.__file__, "graphs", name, DATA, target)
        if not worker.load(target):
            target.unlink()
            return False
    elif kind == "matches":
        _once(inputs / "maps", lambda part: code.python(worker.__file__, "maps", DATA, part))
        known = () if reference is None else (reference / item,)
        code.python(worker.__file__, "matches", name, inputs / "maps", target, *known)
    else:
        if name in runs.NEEDS:
            runs.make_drive(runs.NEEDS[name], code.python, inputs, DATA)
        shutil.rmtree(target, ignore_errors=True)
        runs.make_run(name, code.python, inputs, DATA, target)
    times = {"wall_s": round(time.perf_counter() - began, 1), "cpu_s": round(_cpu_s() - cpu, 1)}
    done.write_text(json.dumps(times))
    print(f"  made {item}: {times['wall_s']} s, {times['cpu_s']} s of the CPU", flush=True)
    return True


def _once(path: Path, make: Callable[[Path], None]) -> None:
    if not path.exists():
        part = path.with_name(f"{path.name}.part")
        make(part)
        part.rename(path)


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def item_lines(item: str, reference: Path, new: Path) -> list[str]:
    """What differs between two makings of an item; no line if nothing does."""
    if item.startswith("runs/"):
        return folder_lines(reference / item, new / item)
    old, now = worker.load(reference / item), worker.load(new / item)
    return plan_lines(old, now) if item.startswith("graphs/") else match_lines(old, now)


def make(options: argparse.Namespace, items: Sequence[str]) -> int:
    """The command `make`."""
    reference, about = options.out / "reference", options.out / "about.json"
    with code_of(options, options.out) as path:
        digest = Code(path, options.out).digest()
        if about.exists() and json.loads(about.read_text())["digest"] != digest:
            raise UserError(f"{options.out}: holds references of other code; remove the folder or give another --out")
        reference.mkdir(parents=True, exist_ok=True)
        about.write_text(json.dumps({"digest": digest, "of": options.commit or str(path)}))
        code = Code(path, reference)
        for item in items:
            if not make_item(item, code, reference, options.out / "inputs", None):
                print(f"  {item}: left out, needs {DATA}")
    print(f"references of {options.commit or path} ({digest}) are in {options.out}")
    return 0


def compare(options: argparse.Namespace, items: Sequence[str]) -> int:
    """The command `compare`; returns 1 if anything moved."""
    reference, about = options.out / "reference", options.out / "about.json"
    if not about.exists():
        raise UserError(f"{options.out}: no references there; run 'python -m tests.golden make --commit C' first")
    known = [item for item in items if (reference / f"{item}.done").exists()]
    if not known:
        raise UserError(f"{options.out}: no references of {', '.join(options.only)}; run 'make' with them first")
    moved = []
    with code_of(options, options.out) as path:
        digest = Code(path, options.out).digest()
        new = options.out / "compared" / digest
        if options.again:
            shutil.rmtree(new, ignore_errors=True)
        new.mkdir(parents=True, exist_ok=True)
        for item in known:
            try:
                made = make_item(item, Code(path, new), new, options.out / "inputs", reference)
                lines = item_lines(item, reference, new) if made else [f"cannot be made, needs {DATA}"]
            except UserError as error:  # a run that fails has moved
                lines = [f"failed: {error}"]
            moved += [item] * bool(lines)
            print(f"{item}: {'moved' if lines else 'bit-equal'}", *lines, sep="\n    ", flush=True)
    of = json.loads(about.read_text())["of"]
    print(f"{path} ({digest}) against {of}: ", end="")
    print(f"{len(moved)} of {len(known)} moved: {', '.join(moved)}" if moved else f"bit-equal in all {len(known)}")
    return 1 if moved else 0


def chosen(only: Sequence[str]) -> list[str]:
    """The items that --only names: a kind, KIND/NAME or NAME; all without it. Raises UserError for another name."""
    for name in only:
        if not any(name in (item, *item.split("/")) for item in ITEMS):
            raise UserError(f"--only {name}: there are graphs, matches, runs and {', '.join(ITEMS)}")
    return [item for item in ITEMS if not only or any(name in (item, *item.split("/")) for name in only)]


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    parser = Parser(prog="python -m tests.golden", description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", metavar="make | compare", required=True)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sgslam-golden"
    for name, about in (("make", "make references"), ("compare", "compare with them")):
        command = commands.add_parser(name, help=about, description=about)
        which = command.add_mutually_exclusive_group()
        which.add_argument("--commit", metavar="C", help="the code of a commit, in a temporary git worktree")
        which.add_argument("--code", type=Path, metavar="DIR", help="the code of a checkout (default: this one)")
        command.add_argument("--out", type=Path, default=cache, metavar="DIR", help=f"references (default: {cache})")
        command.add_argument("--only", nargs="+", default=[], metavar="NAME", help="graphs, matches, runs, or by name")
    command.add_argument("--again", action="store_true", help="also what an earlier comparison of this code has made")
    options = parser.parse_args(arguments)
    options.out = options.out.resolve()
    return {"make": make, "compare": compare}[options.command](options, chosen(options.only))


if __name__ == "__main__":
    run_command(main)
