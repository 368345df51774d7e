"""Parses `--odometry`: the name of a method, or a trajectory file."""

import difflib
from pathlib import Path

from data.common.errors import UserError
from sgslam.config import Config
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.factory import METHODS


def choose(value: str, config: Config) -> tuple[Config, ExternalOdometry | None]:
    """The settings with the method `value`, or the odometry of the TUM file `value`.

    Raises UserError if it is neither, or the file cannot be read.
    """
    if value in METHODS:
        return config.model_copy(update={"odometry": config.odometry.model_copy(update={"method": value})}), None
    path = Path(value)
    if path.exists():
        return config, ExternalOdometry.read(path)
    near = difflib.get_close_matches(value, METHODS, 1, 0.5)
    hint = f"did you mean {near[0]}?" if near else f"give {', '.join(METHODS)}, or a TUM file"
    raise UserError(f"--odometry {value}: no such file, and no such method; {hint}")


def health_note(method: str) -> str | None:
    """What a user must know of the health that this method gives to scans; None where it judges each scan."""
    if method == "continuous_time":
        return None
    note = f"odometry {method} does not judge scans: they are good, or lost after an implausible step"
    if method != "small_gicp":
        note += "; their sigmas come from the settings odometry.other_sigma_rotation and other_sigma_translation alone"
    return f"{note}; health and quality of this run say little"
