"""The log of the process that tracks, sent to the one that keeps the log of the run."""

import logging
from contextlib import suppress

from data.common.errors import UserError
from sgslam.cli.processes.mapping_process import MappingProcess
from sgslam.cli.processes.messages import LogMessage


class LogLines(logging.Handler):
    """Sends log lines to the process that keeps the log of the run."""

    def __init__(self, to: MappingProcess) -> None:
        super().__init__(logging.INFO)
        self._to = to

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        with suppress(UserError):  # the other process has ended
            self._to.put(LogMessage(record.name, record.levelno, record.getMessage()))
