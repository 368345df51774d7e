"""What `--odometry` may say: a method's name, or a trajectory's file."""

import difflib
from pathlib import Path

from data.common.errors import UserError
from sgslam.config import Config
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.factory import METHODS


def choose(told: str, config: Config) -> tuple[Config, ExternalOdometry | None]:
    """The settings with the method that was told, or the odometry that a TUM file gives.

    Raises UserError for what is neither, and for a file that cannot be read.
    """
    if told in METHODS:
        return config.model_copy(update={"odometry": config.odometry.model_copy(update={"method": told})}), None
    path = Path(told)
    if path.exists():
        return config, ExternalOdometry.read(path)
    near = difflib.get_close_matches(told, METHODS, 1, 0.5)
    hint = f"did you mean {near[0]}?" if near else f"give {', '.join(METHODS)}, or a TUM file"
    raise UserError(f"--odometry {told}: no such file, and no such method; {hint}")
