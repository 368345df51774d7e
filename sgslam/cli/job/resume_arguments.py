"""`--resume OUT`: stores the arguments of a run and restores them when it is resumed."""

import argparse
from pathlib import Path
from typing import Any

from data import UserError
from data.scans.evalio import is_evalio
from sgslam.session.checkpoints import about_run

_PATHS = ("scan_dir", "bim", "ground_truth", "map", "imu", "slam_output", "cloud", "times")
_WORDS = ("topic", "imu_topic", "start", "storey", "mount", "stamp", "tolerance", "odometry", "single_pass")


def run_arguments(options: argparse.Namespace) -> dict[str, str | bool | None]:
    """The arguments that `--resume` restores, in JSON form."""
    paths = {name: getattr(options, name) for name in _PATHS}
    stored = {name: None if path is None else _lasting(path) for name, path in paths.items()}
    words: dict[str, str | bool | None] = {name: getattr(options, name) for name in _WORDS}
    if options.odometry is not None and Path(options.odometry).is_file():
        words["odometry"] = str(Path(options.odometry).resolve())
    return stored | words


def _lasting(path: Path) -> str:
    """The path from any folder; a data set's sequence is no path."""
    return str(path if is_evalio(path) else path.resolve())


def restore_arguments(options: argparse.Namespace) -> dict[str, Any]:
    """Fills `options` with the arguments of the run in the folder `options.resume`; returns the header of its state.

    Raises UserError if there is no such run, if it is finished, and for options that conflict with `--resume`.
    """
    folder: Path = options.resume
    if options.demo or options.out not in (None, folder):
        raise UserError(f"--resume {folder}: continues in that folder; leave out --demo and --out")
    about = about_run(folder)
    if about.get("finished"):
        raise UserError(f"--resume {folder}: that run is finished; its results are in the folder")
    stored = about.get("arguments", {})
    if stored and stored.get("scan_dir") is None and stored.get("slam_output") is None:
        raise UserError(f"--resume {folder}: that run was live, and cannot continue; start a new one")
    for name in (*_PATHS, *_WORDS):
        if getattr(options, name) is None and stored.get(name) is not None:
            setattr(options, name, Path(stored[name]) if name in _PATHS else stored[name])
    options.out = folder
    return about
