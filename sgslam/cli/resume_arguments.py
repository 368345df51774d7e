"""`--resume OUT`: what a run was told when it began is told again, so that it need not be given twice."""

import argparse
from pathlib import Path
from typing import Any

from data import UserError
from sgslam.session.checkpoints import about_run

_PATHS = ("scan_dir", "bim", "ground_truth", "map")
_WORDS = ("topic", "start", "storey", "odometry")


def told_by(options: argparse.Namespace) -> dict[str, str | None]:
    """What a later `--resume` is to be told again, as JSON."""
    paths = {name: getattr(options, name) for name in _PATHS}
    told = {name: None if path is None else str(path.resolve()) for name, path in paths.items()}
    words: dict[str, str | None] = {name: getattr(options, name) for name in _WORDS}
    if words["odometry"] is not None and Path(words["odometry"]).is_file():
        words["odometry"] = str(Path(words["odometry"]).resolve())
    return told | words


def take_up(options: argparse.Namespace) -> dict[str, Any]:
    """Fills `options` with what the run in the folder `options.resume` was told; returns what that run is of.

    Raises UserError where there is no such run, where it is finished, and for options that do not go with it.
    """
    folder: Path = options.resume
    if options.demo or options.out not in (None, folder):
        raise UserError(f"--resume {folder}: goes on with that run, in that folder; leave --demo and --out out")
    about = about_run(folder)
    if about.get("finished"):
        raise UserError(f"--resume {folder}: that run is finished; its results are there")
    told = about.get("arguments", {})
    for name in (*_PATHS, *_WORDS):
        if getattr(options, name) is None and told.get(name) is not None:
            setattr(options, name, Path(told[name]) if name in _PATHS else told[name])
    options.out = folder
    return about
