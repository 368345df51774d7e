"""`python -m tests.mutation`: changes thresholds and comparisons one by one, and tells which changes no test notices.

Numbers in comparisons and in constants of modules and classes are doubled and halved, comparisons made strict or lax or
turned round, `and` and `or`, `min` and `max` swapped. Each mutant runs the tests of its module, in a copy of the
checkout; a test that runs much longer than usual counts as a failed one. Some survivors mean the same as the original.
"""

import argparse
import ast
import importlib
import math
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = "anchor_log anchored_rooms free_space_conflict place_posterior storey_hypotheses"
ANCHORING = tuple(f"tests/sgslam/anchoring/test_{name}.py" for name in f"{PLACES} consensus".split())
BUILDING = ("tests/sgslam/anchoring/test_building_anchoring.py",)
FLOORS = (*BUILDING, *(f"tests/sgslam/anchoring/test_{name}.py" for name in ("floor_anchoring", "mirror_image")))
SOUNDNESS = ("tests/sgslam/outputs/test_soundness.py",)
VERDICTS = ("tests/matching/test_verdicts.py",)
TESTS = {  # of each module; what is compiled once must not be compiled for each mutant
    **{f"sgslam/anchoring/{name}.py": ANCHORING for name in f"{PLACES} plan se2_consensus".split()},
    "sgslam/anchoring/building_anchoring.py": BUILDING,
    **{f"sgslam/anchoring/floor_{name}.py": FLOORS for name in ("anchoring", "matching")},
    **{name: SOUNDNESS for name in ("sgslam/anchoring/soundness.py", "sgslam/session/soundness/free_space.py")},
    "sgslam/registration/health.py": ("tests/sgslam/registration/test_health.py",),
    "sgslam/session/soundness/quality.py": ("tests/sgslam/outputs/test_quality.py",),
    "matching/engine/verdict.py": VERDICTS,
    "matching/engine/alternatives.py": (
        *VERDICTS, "tests/matching/test_equal_rooms.py", "tests/matching/test_verified_matching.py",
    ),
}  # fmt: skip
COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.GtE), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
}  # fmt: skip
SWAPPED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
LOADED = ("numpy", "scipy.spatial", "shapely", "numba", "gtsam", "pydantic", "hypothesis", "pytest")  # once for all
PATIENCE_S = 240.0  # beyond three times the usual: a mutant may compile its functions again


@dataclass(frozen=True)
class Mutant:
    """The source of a module with one change; `line` (from 1) and `what` say which."""

    line: int
    what: str
    source: str


def mutants(source: str) -> list[Mutant]:
    """All mutants of a module, by their lines."""
    tree = ast.parse(source)
    known = ast.unparse(tree)
    thresholds = {id(number) for node in ast.walk(tree) for number in _thresholds(node)}
    found: dict[str, Mutant] = {}
    for node in ast.walk(tree):
        for what in _changed(node, id(node) in thresholds):
            text = ast.unparse(tree)
            if text != known:
                found.setdefault(text, Mutant(node.lineno, what, text))  # type: ignore[attr-defined]
    return sorted(found.values(), key=lambda mutant: mutant.line)


def _thresholds(node: ast.AST) -> Iterator[ast.Constant]:
    """The numbers of a comparison, and of the constants of a module or class."""
    if isinstance(node, ast.Compare):
        yield from _numbers(node)
    elif isinstance(node, ast.Module | ast.ClassDef):
        for statement in node.body:
            if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
                yield from _numbers(statement.value)


def _numbers(node: ast.AST) -> Iterator[ast.Constant]:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield node
    for name, _ in ast.iter_fields(node):
        if not (isinstance(node, ast.Subscript) and name == "slice"):
            part = getattr(node, name)
            for child in part if isinstance(part, list) else [part]:
                if isinstance(child, ast.AST):
                    yield from _numbers(child)


def _changed(node: ast.AST, threshold: bool) -> Iterator[str]:
    """Changes a node, tells how, and changes it back, for each of its mutants."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in COMPARED.get(type(op), ()):
                node.ops[k] = other()
                yield f"to {ast.unparse(node)}"
            node.ops[k] = op
    elif isinstance(node, ast.BoolOp):
        op = node.op
        node.op = ast.Or() if isinstance(op, ast.And) else ast.And()
        yield f"to {ast.unparse(node)}"
        node.op = op
    elif isinstance(node, ast.Constant) and threshold:
        value = node.value
        for other_value in (2 * value, value // 2 if isinstance(value, int) else value / 2):
            node.value = other_value
            yield f"{value} to {other_value}"
        node.value = value
    elif isinstance(node, ast.Name | ast.Attribute):
        field = "id" if isinstance(node, ast.Name) else "attr"
        name = getattr(node, field)
        if name in SWAPPED:
            setattr(node, field, SWAPPED[name])
            yield f"{name} to {SWAPPED[name]}"
            setattr(node, field, name)


class Checkout:
    """A copy of the files that git knows or would take, in a temporary folder."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "checkout"
        listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines():
            if (ROOT / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, self.root / name)
        if (ROOT.parent / "shared").is_dir():
            (folder / "shared").symlink_to(ROOT.parent / "shared")
        os.environ |= {"NUMBA_CACHE_DIR": str(folder / "numba"), "PYTHONPATH": str(self.root), "OMP_NUM_THREADS": "1"}

    def passes(self, tests: tuple[str, ...], limit_s: float | None = None) -> bool:
        """Whether all tests pass, within the limit."""
        process = multiprocessing.get_context("fork").Process(target=self._run, args=(tests,))
        process.start()
        process.join(limit_s)
        if process.is_alive():
            process.kill()
            process.join()
        return process.exitcode == 0

    def write(self, module: str, source: str) -> None:
        """Replaces a module, and forgets its byte code: that goes by seconds and size."""
        path = self.root / module
        path.write_text(source)
        for old in path.parent.glob(f"__pycache__/{path.stem}.*.pyc"):
            old.unlink()

    def _run(self, tests: tuple[str, ...]) -> None:
        import pytest

        os.chdir(self.root)
        sys.path[:] = [str(self.root), *(entry for entry in sys.path if Path(entry or ROOT).resolve() != ROOT)]
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        options = ["-x", "-q", "-m", "not slow", "-p", "no:xdist", "-p", "no:cacheprovider"]
        os._exit(int(pytest.main([*options, *tests])))


def survivors(checkout: Checkout, module: str, limit: int | None) -> tuple[list[Mutant], int]:
    """The mutants of a module that its tests do not notice, and how many were tried: all, or so many of them."""
    source = (checkout.root / module).read_text()
    tests = TESTS[module]
    checkout.passes(tests)  # compiles
    began = time.perf_counter()
    if not checkout.passes(tests):
        raise SystemExit(f"{module}: its tests fail without any change: {' '.join(tests)}")
    usual_s = time.perf_counter() - began
    every = mutants(source)
    chosen = every[:: max(1, math.ceil(len(every) / limit))] if limit else every
    left = []
    for mutant in chosen:
        checkout.write(module, mutant.source)
        if checkout.passes(tests, 3 * usual_s + PATIENCE_S):
            left.append(mutant)
            line = source.splitlines()[mutant.line - 1].strip()
            print(f"{module}:{mutant.line}: {mutant.what}   | {line}", flush=True)
    checkout.write(module, source)
    return left, len(chosen)


def main() -> None:
    """Tries the mutants of the chosen modules and prints those that survive, and the share that is killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=main.__doc__)
    parser.add_argument("--module", action="append", choices=TESTS, metavar="FILE", help="one of: " + ", ".join(TESTS))
    parser.add_argument("--limit", type=int, metavar="N", help="at most so many mutants of each module, evenly chosen")
    options = parser.parse_args()
    for name in LOADED:
        importlib.import_module(name)
    with tempfile.TemporaryDirectory() as folder:
        checkout = Checkout(Path(folder))
        for module in options.module or TESTS:
            left, tried = survivors(checkout, module, options.limit)
            killed = tried - len(left)
            print(f"{module}: {killed} of {tried} killed, {100 * killed / max(tried, 1):.0f} %", flush=True)


if __name__ == "__main__":
    main()
