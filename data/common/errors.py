"""The exceptions for a user's mistakes, printed as one line with exit code 2, and those of readers of scans; and how
exceptions of libraries become one."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class UserError(Exception):
    """A mistake of the user: what is wrong, where, and what to do, in one line. Commands print it and exit with 2."""


class UnreadableScanError(Exception):
    """A scan that cannot be read; the text is the reason."""


class EndOfScansError(Exception):
    """There are no more scans."""


def reason(error: BaseException) -> str:
    """What a library says of bytes that it cannot read, in a line."""
    first = (str(error).splitlines() or [""])[0][:120]
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


@contextmanager
def refusing(what: str, advice: str = "", kind: type[Exception] = UserError) -> Iterator[None]:
    """Context in which whatever a library raises on garbage becomes one line: `what`, the reason, and the `advice`."""
    try:
        yield
    except (UserError, UnreadableScanError, EndOfScansError):
        raise
    except Exception as error:
        raise kind(f"{what} ({reason(error)})" + (f"; {advice}" if advice else "")) from None


def required(module: str, what: str, extra: str) -> Any:
    """A module that `what` needs. Raises UserError, which names the extra to install, where it is missing."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UserError(f"{what} needs {module.partition('.')[0]}: pip install 'sgslam[{extra}]'") from None
