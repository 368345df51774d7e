"""What a worker of a Dask cluster does for `data.common.cluster`: one task, after a look at whether its answer would
count."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

from data.common.build import build
from data.common.children import ProcessEndedError
from data.common.errors import UserError

CHUNK = 1 << 20


@dataclass(frozen=True)
class RoomsNeeded:
    """A file or folder that the tasks read, and a digest of what it holds on the machine that asks."""

    path: str
    digest: str

    @staticmethod
    def of(path: Path | str) -> "RoomsNeeded":
        """Raises UserError where there is none."""
        if not Path(path).exists():
            raise UserError(f"{path}: there is no such file or folder")
        return RoomsNeeded(str(path), _digest(str(path)))


@dataclass(frozen=True)
class Work:
    """What is done with every task, and what must be the same here as where it was asked for."""

    function: Callable[[Any], Any]
    build: str
    needed: tuple[RoomsNeeded, ...]

    @staticmethod
    def of(function: Callable[[Any], Any], files: Iterable[Path | str]) -> "Work":
        """By what is installed and what lies here. Raises UserError for a file that is not there."""
        return Work(function, build(), tuple(map(RoomsNeeded.of, files)))


@dataclass(frozen=True)
class Refused:
    """Why all tasks would go wrong; a mistake of the user's."""

    why: str


def do(work: Work, task: Any) -> Any:
    """The task's answer, or Refused; raises what a task that may pass elsewhere raises."""
    try:
        _check_build(work.build)
        _check_files(work.needed)
        return work.function(task)
    except ProcessEndedError:
        raise
    except UserError as error:
        return Refused(f"{_place()}: {error}")


def itself(work: Work) -> Work:
    """As a task of its own, `work` goes to a worker once, not with every task, and is not lost with the worker."""
    return work


def scratch() -> Path:
    """This worker's own folder, gone when the worker ends."""
    from distributed import get_worker

    folder = Path(get_worker().local_directory) / "sgslam"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _check_build(wanted: str) -> None:
    if build() != wanted:
        raise UserError(f"has sgslam {build()}, and here it is {wanted}; install the same on all machines")


@lru_cache(maxsize=8)
def _check_files(needed: tuple[RoomsNeeded, ...]) -> None:
    """Once for all tasks; a refusal is not remembered, since the user may mend it."""
    for file in needed:
        where = file.path if Path(file.path).is_absolute() else f"{file.path} (in {os.getcwd()})"
        if not Path(file.path).exists():
            raise UserError(f"does not see {where}; it must lie at the same path on all machines")
        if _digest(file.path) != file.digest:
            raise UserError(f"sees another {where} than here; it must be the same on all machines")


def _digest(path: str) -> str:
    """Of a file's bytes; of the names and sizes of what lies in a folder, since scans are large."""
    digest = blake2b(digest_size=16)
    if Path(path).is_dir():
        for file in sorted(Path(path).rglob("*")):
            digest.update(f"{file.relative_to(path)} {file.stat().st_size if file.is_file() else ''}\n".encode())
    else:
        with Path(path).open("rb") as opened:
            while chunk := opened.read(CHUNK):
                digest.update(chunk)
    return digest.hexdigest()


def _place() -> str:
    from distributed import get_worker

    return f"the worker {get_worker().address}"
