"""What all command lines share: a user's mistake is one line on standard error and exit code 2."""

import argparse
import sys
from collections.abc import Callable
from typing import NoReturn

from data.errors import UserError


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Prints the error alone, without the usage, and exits with 2."""
        self.exit(2, f"error: {message}; see '{self.prog} --help'\n")


def run_command(command: Callable[[], int | None]) -> NoReturn:
    """Runs a command and exits with what it returns; a UserError is told in one line, exit code 2."""
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
