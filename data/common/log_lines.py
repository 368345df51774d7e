"""The log of a command: to the terminal, to a file, and its warnings to a list."""

import logging
import sys
from pathlib import Path


class WarningList(logging.Handler):
    """Appends the message of each warning and error to `lines`, each message once."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
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
