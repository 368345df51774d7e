"""Commands as they are called, in this process: libraries are loaded once for all calls."""

import importlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from subprocess import CompletedProcess
from unittest.mock import patch

from data.common.cli import run_command


def called(module: str, *arguments: object) -> CompletedProcess[str]:
    """What `python -m MODULE ARGUMENTS` ends with and says; each command has a test as a process of its own too."""
    words = [module, *map(str, arguments)]
    loaded = importlib.import_module(module)
    main = (importlib.import_module(f"{module}.__main__") if hasattr(loaded, "__path__") else loaded).main
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err), _logger_left_alone(), patch.object(sys, "argv", words):
        try:
            run_command(main)
        except SystemExit as ended:
            code = ended.code
    assert isinstance(code, int)
    return CompletedProcess(words, code, out.getvalue(), err.getvalue())


def refused(module: str, *arguments: object) -> str:
    """What a command says of a user's mistake: one line, `error: ...`, and no more."""
    done = called(module, *arguments)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1, done.stderr
    return done.stderr


@contextmanager
def _logger_left_alone() -> Iterator[None]:
    logger = logging.getLogger("sgslam")
    handlers, level, raised = logger.handlers, logger.level, logging.raiseExceptions
    try:
        yield
    finally:
        for handler in logger.handlers:
            if handler not in handlers:
                handler.close()
        logger.handlers, logging.raiseExceptions = handlers, raised
        logger.setLevel(level)
