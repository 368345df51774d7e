"""What `anchor` still takes from parsed arguments where it anchors a graph without clouds."""

from argparse import Namespace
from pathlib import Path
from typing import Any

from sgslam.cli.job.inputs import default_out
from sgslam.cli.options import Triple
from sgslam.session.result import prepare_folder


def out_folder(options: Namespace) -> Path:
    """The folder for the results, created if needed. Raises UserError if it cannot be written to."""
    return prepare_folder(options.out or default_out())


def three_numbers(option: str, value: Any, form: str, example: str) -> Triple:
    """The numbers of an option, which are read and checked already."""
    a, b, c = value
    return a, b, c
