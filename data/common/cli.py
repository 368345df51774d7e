"""Common to all commands: a user's mistake gives one line on standard error and exit code 2; the log."""

import argparse
import difflib
import logging
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NoReturn

from data.common.errors import UserError

_called: ContextVar[str | None] = ContextVar("the name under which a command was called", default=None)


@contextmanager
def called_as(name: str) -> Iterator[None]:
    """Context in which a command's help and errors use this name instead of its own."""
    before = _called.set(name)
    try:
        yield
    finally:
        _called.reset(before)


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line. `prog` is the command's own name; see `called_as`."""

    def __init__(self, prog: str | None = None, **options: Any) -> None:
        called = _called.get()
        is_part = called is not None and prog is not None and prog.startswith(f"{called} ")  # of a parser so called
        super().__init__(prog if is_part else called or prog, **options)
        self._negative_number_matcher = re.compile(r"-[\d.]")  # -25,0,0 is a value as well

    def error(self, message: str) -> NoReturn:
        """Raises UserError, in one line without the usage."""
        unknown = re.match(r"unrecognized arguments: (--[^ =]+)", message)
        near = difflib.get_close_matches(unknown[1], self._option_string_actions, 1) if unknown else []
        hint = "".join(f"; did you mean {own}?" for own in near)
        raise UserError(f"{message}{hint}; see '{self.prog} --help'")


def add_workers(parser: argparse.ArgumentParser, local: str, help_local: str) -> None:
    """Adds `--scheduler` and the option `local` for a number of local processes; they exclude each other."""
    either = parser.add_mutually_exclusive_group()
    either.add_argument(local, type=int, default=1, metavar="N", help=help_local)
    about = "Dask scheduler whose workers do the work, with the same sgslam and files: see docs/batch.md"
    either.add_argument("--scheduler", metavar="tcp://HOST:PORT", help=about)


def run_command(command: Callable[[], int | None]) -> NoReturn:
    """Runs a command and exits with its return value; a UserError gives one line and exit code 2."""
    try:
        code = command() or 0
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except OSError as error:
        print(f"error: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


class WarningList(logging.Handler):
    """Appends the message of each warning and error to `lines`, each message once."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        line = record.getMessage()
        if line not in self.lines:
            self.lines.append(line)


def log_to(logger: logging.Logger, path: Path, *, verbose: bool, append: bool) -> list[str]:
    """Directs a logger to the file `path` and, from warnings on or all if `verbose`, to standard error.

    Returns the list that takes the messages of its warnings. Handlers that the logger had are replaced.
    """
    logging.raiseExceptions = False  # on a full disk the run continues without its log
    logger.setLevel(logging.DEBUG if verbose else logging.INFO)
    screen = logging.StreamHandler(sys.stderr)
    screen.setLevel(logging.DEBUG if verbose else logging.WARNING)
    screen.setFormatter(logging.Formatter("%(message)s"))
    file = logging.FileHandler(path, mode="a" if append else "w")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    warnings = WarningList([])
    logger.handlers = [screen, file, warnings]
    return warnings.lines
