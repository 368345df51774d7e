"""The worker's side of `data.common.cluster`: runs one task after checking that its result would be valid."""

from collections.abc import Callable
from functools import lru_cache
from hashlib import blake2b, file_digest
from pathlib import Path
from typing import Any

from data.common.build import build
from data.common.children import ProcessEndedError
from data.common.errors import UserError

Digests = tuple[tuple[str, str], ...]  # paths and the digests of what the caller sees there


def do(function: Callable[[Any], Any], wanted_build: str, digests: Digests, task: Any) -> Any:
    """Returns the task's result, or a UserError, since Dask would retry what raises."""
    from distributed import get_worker

    try:
        if build() != wanted_build:
            raise UserError(f"must have sgslam {wanted_build} as the caller, but has: {build()}")
        _check(digests)
        return function(task)
    except ProcessEndedError:
        raise
    except UserError as error:
        return UserError(f"the worker {get_worker().address}: {error}")


def scratch() -> Path:
    """The worker's own folder, removed when the worker ends."""
    from distributed import get_worker

    return Path(get_worker().local_directory)


def digest(path: Path | str) -> str:
    """A digest of a file's bytes, or of the names and sizes in a folder, since scans are large. Raises OSError."""
    if Path(path).is_dir():
        files = sorted(file for file in Path(path).rglob("*") if file.is_file())
        return blake2b("\n".join(f"{f.relative_to(path)} {f.stat().st_size}" for f in files).encode()).hexdigest()
    with Path(path).open("rb") as opened:
        return file_digest(opened, "blake2b").hexdigest()


@lru_cache(maxsize=8)
def _check(digests: Digests) -> None:
    """Checks files once for all tasks; an error is not cached, since the user may correct it."""
    for path, wanted in digests:
        if not Path(path).exists() or digest(path) != wanted:
            raise UserError(f"{Path(path).absolute()} must be there, and the same as on the caller's machine")
