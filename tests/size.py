"""`python -m tests.size [COMMIT]`: files, formatted lines and statements of each package, words of the documentation.

Lines are counted as the formatter leaves them, those that are exempt from it formatted too, so that packing lines
does not count as fewer; statements are those of Python's syntax tree.
"""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data", "factors", "matching", "sgslam", "evaluation", "tests")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def _formatted(source: str) -> str:
    """The source as the formatter writes it without exceptions and without commas that hold lines apart."""
    plain = source.replace("# fmt: skip", "").replace("# fmt: off", "")
    command = [Path(sys.executable).with_name("ruff"), "format", "--config", ROOT / "pyproject.toml", "-"]
    return subprocess.run(command, input=plain, capture_output=True, text=True, check=True).stdout


def main() -> int:
    """Prints the table of a commit (default: HEAD)."""
    commit = sys.argv[1] if len(sys.argv) > 1 else "HEAD"
    names = _git("ls-tree", "-r", "--name-only", commit).splitlines()
    print(f"{'package':12}{'files':>6}{'lines':>8}{'statements':>12}")
    for package in PACKAGES:
        files = [name for name in names if name.startswith(f"{package}/") and name.endswith(".py")]
        sources = [_git("show", f"{commit}:{name}") for name in files]
        lines = sum(_formatted(source).count("\n") for source in sources)
        statements = sum(isinstance(node, ast.stmt) for source in sources for node in ast.walk(ast.parse(source)))
        print(f"{package:12}{len(files):6}{lines:8}{statements:12}")
    pages = [name for name in names if name.endswith(".md")]
    words = sum(len(_git("show", f"{commit}:{name}").split()) for name in pages)
    print(f"{'pages':12}{len(pages):6}{words:8} words")
    return 0


if __name__ == "__main__":
    sys.exit(main())
