"""The odometry that the settings or `--odometry` name."""

import difflib
from pathlib import Path
from typing import get_args

from data.common.errors import UserError
from sgslam.config import Config, OdometrySettings
from sgslam.odometry.base import Odometry
from sgslam.odometry.external import ExternalOdometry

METHODS: tuple[str, ...] = get_args(OdometrySettings.model_fields["method"].annotation)


def make_odometry(config: Config) -> Odometry | None:
    """The odometry of others that is named in the settings; None for our own."""
    if config.odometry.method == "kiss":
        from sgslam.odometry.kiss import KissOdometry

        return KissOdometry(config.odometry, config.tracking)
    if config.odometry.method == "small_gicp":
        from sgslam.odometry.small_gicp import SmallGicpOdometry

        return SmallGicpOdometry(config.tracking)
    return None


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
