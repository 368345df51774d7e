"""Functions compiled to machine code, for the few loops that numpy cannot express."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any, TypeVar

from numba import config, njit, types
from numba.extending import intrinsic

from data.common.build import PRODUCT

_F = TypeVar("_F", bound=Callable[..., object])
MOST_VERSIONS = 5  # on disk, of some 12 MB each


def sources(root: Path) -> list[Path]:
    """The files that compiled functions and their constants come from: those that contain the word `compiled`."""
    files = (path for package in PRODUCT for path in sorted((root / package).rglob("*.py")))
    return [path for path in files if b"compiled" in path.read_bytes()]


def version(root: Path) -> str:
    """A hash of the sources. Numba itself only checks a function's own file and would keep outdated callees and
    constants.
    """
    digest = blake2b(digest_size=8)
    for path in sources(root):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def folder(parent: Path, version: str) -> Path:
    """Returns the folder for a version's machine code, created if needed; the oldest other versions are removed.

    If it cannot be created, numba chooses another place.
    """
    chosen = parent / f"sgslam-{version}"
    with suppress(OSError):
        if not chosen.is_dir():
            chosen.mkdir(parents=True)
            known = sorted(parent.glob("sgslam-*"), key=lambda path: path.stat().st_mtime)
            for old in known[:-MOST_VERSIONS]:
                shutil.rmtree(old, ignore_errors=True)
    return chosen


_HERE = Path(__file__).resolve().parent
_ROOT = _HERE.parents[1]
FOLDER = folder(Path(config.CACHE_DIR or _HERE / "__pycache__"), version(_ROOT))


def compiled(function: _F) -> _F:
    """Compiles `function` with numba at the first call with given argument types; the result is cached on disk.

    If no folder is writable (a read-only installation without a home), each process compiles again. Arithmetic follows
    IEEE (no fastmath; x / 0 is infinite), so results are reproducible.
    """
    return _compiled(function, inline="never")


def compiled_within(function: _F) -> _F:
    """As `compiled`, but inlined into the compiled function that calls it: for long functions with one caller, which
    would otherwise be compiled twice.
    """
    return _compiled(function, inline="always")


def _compiled(function: _F, inline: str) -> _F:
    options = {"nogil": True, "error_model": "numpy", "inline": inline, "no_cfunc_wrapper": True}
    others, config.CACHE_DIR = config.CACHE_DIR, str(FOLDER)  # for ours alone, not for an application's own functions
    try:
        fast: _F = njit(function, cache=True, **options)
    except RuntimeError:  # "cannot cache function: no locator available"
        fast = njit(function, **options)
    finally:
        config.CACHE_DIR = others
    return fast


@intrinsic  # type: ignore[untyped-decorator]
def power_of_two(typing_context: Any, exponent: Any) -> Any:
    """2 to an integer power from -126 to 127, in single precision; for compiled functions."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        real = context.get_value_type(types.float32)
        whole = context.get_value_type(types.int32)
        bits = builder.shl(builder.add(builder.fptosi(arguments[0], whole), whole(127)), whole(23))
        return builder.bitcast(bits, real)

    return types.float32(types.float32), code
